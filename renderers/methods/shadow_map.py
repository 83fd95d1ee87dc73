"""Shadow map at the centre of each area light: hard shadows (taps = 1), or percentage-closer filtering over taps² texels.

One map per light, one width of penumbra everywhere: the baseline that shows what a soft shadow method is for. Comparison first,
mean after (Reeves, Salesin & Cook 1987). Settings: those of `soft_shadows`, and taps.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from renderers.method import register, setting
from renderers.methods.soft_shadows import SoftShadows, SoftShadowSettings
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.shading import F64, Hidden


class ShadowMapSettings(SoftShadowSettings):
    """Settings of the central shadow map."""

    map_resolution: int = setting(1024, "texels across a shadow map", unit="px", source="Williams 1978", ge=8, le=4096)
    taps: int = setting(1, "texels of the filter's side; 1: hard shadows", unit="px", source="Reeves et al. 1987", ge=1, le=63)


class ShadowMap(SoftShadows):
    """Shadows of area lights as if they were points at their centres."""

    name = "shadow-map"
    title = "Shadow map at the light's centre, with percentage-closer filtering"
    source = "Williams 1978; Reeves, Salesin & Cook 1987"
    Settings = ShadowMapSettings
    how_area = "casts shadows from its centre alone; their edges are hard, or blurred by one fixed width"
    horizon = False

    def warm_up(self) -> None:
        """Import the kernels."""
        import renderers.transport.penumbra.filtered  # noqa: F401

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """One map per light."""
        from renderers.transport.penumbra.filtered import filtered_maps, percentage_closer

        maps = filtered_maps(world, emitters, points, settings.map_resolution, settings.near, counters, central=True)
        kernel = percentage_closer(settings.bias, settings.taps)
        return lambda k, positions, normals: maps[k].hidden(positions, normals, kernel)


register(ShadowMap)
