"""Layered attenuation maps (Agrawala et al. 2000): hidden shares on the surfaces that N shadow maps see, kept in layers per pixel.

    V(layer) = 1 - (light points that see the layer) / N

Every texel of N shadow maps is dropped into the pixel of a pyramid at the light's centre that holds it; what lies together in depth
is a layer. A lookup takes the layer at the point's depth and is fully shadowed without one. Compare with `pdsm`: no value off the
surfaces, and holes between the texels, which grow with the light. Settings: those of `soft_shadows`, resolution, tolerance and
filter.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from renderers.method import register, setting
from renderers.methods.soft_shadows import SoftShadows, SoftShadowSettings
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.shading import F64, Hidden


class LayeredAttenuationMapSettings(SoftShadowSettings):
    """Settings of layered attenuation maps."""

    resolution: int = setting(256, "pixels of a pyramid across 90°", unit="px", source="Agrawala et al. 2000 §3", ge=8, le=4096)
    map_resolution: int = setting(
        256, "texels across a shadow map; twice the pyramid's nearly closes the holes", unit="px", source="Agrawala et al. 2000 §3",
        ge=8, le=4096,
    )  # fmt: skip
    tolerance: float = setting(
        2.0, "depth within which points are one layer, in footprints of a pixel", unit="px", source="Agrawala et al. 2000 §3",
        ge=0.01, le=100,
    )  # fmt: skip
    filter: Literal["bilinear", "nearest"] = setting(
        "bilinear", "between layers of neighbouring pixels", source="St-Amour 2004 §2.4"
    )


class LayeredAttenuationMap(SoftShadows):
    """Soft shadows of area lights, counted where surfaces are."""

    name = "layered-attenuation-map"
    title = "Layered attenuation map"
    source = "Agrawala, Ramamoorthi, Heirich & Moll 2000"
    Settings = LayeredAttenuationMapSettings
    how_area = "the hidden share weighs all parts of a light alike, and is unknown (black) between the texels of its shadow maps"

    def warm_up(self) -> None:
        """Import the kernels."""
        import renderers.transport.penumbra.layered  # noqa: F401

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """Layers around every light."""
        from renderers.transport.penumbra.layered import LayeredLight

        s = settings
        lights = [
            LayeredLight(world, emitter, p, s.resolution, s.map_resolution, s.near, s.tolerance, counters)
            for emitter, p in zip(emitters, points, strict=True)
        ]
        return lambda k, positions, normals: lights[k].hidden(positions, s.filter)


register(LayeredAttenuationMap)
