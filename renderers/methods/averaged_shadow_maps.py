"""Averaged shadow maps (Brotman & Badler 1984): the mean of N shadow tests at each shaded point.

    V(P) = 1/N Σ_i [D_i(P) + b < Z_i(P)]

N points on the light, a shadow map from each, one test per map and pixel. It is what `pdsm` tends to with a finer pyramid; all maps
stay in memory and all are read for every pixel. Settings: those of `soft_shadows`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from renderers.method import register
from renderers.methods.soft_shadows import SoftShadows, SoftShadowSettings
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.shading import F64, Hidden


class AveragedShadowMaps(SoftShadows):
    """Soft shadows of area lights as the mean of many hard ones."""

    name = "averaged-shadow-maps"
    title = "Averaged shadow maps"
    source = "Brotman & Badler 1984"
    Settings = SoftShadowSettings
    how_area = "the hidden share weighs all parts of a light alike, from shadow maps of finite resolution"

    def warm_up(self) -> None:
        """Import the kernels."""
        import renderers.transport.penumbra.filtered  # noqa: F401

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """A map per light point."""
        from renderers.transport.penumbra.filtered import averaged, filtered_maps

        maps = filtered_maps(world, emitters, points, settings.map_resolution, settings.near, counters, central=False)
        kernel = averaged(settings.bias)
        return lambda k, positions, normals: maps[k].hidden(positions, normals, kernel)


register(AveragedShadowMaps)
