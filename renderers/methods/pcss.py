"""Percentage-closer soft shadows (Fernando 2005): one shadow map, filtered as wide as the penumbra of the mean blocker.

    w_search = w (1/near - 1/Z)          Z_b = mean depth of blocking texels          w_penumbra = w (Z - Z_b) / (Z_b Z)

in tangents, w the light's half size. Right for one flat blocker parallel to the light; wrong where blockers overlap or hide behind
one another. Settings: those of `soft_shadows`, and taps.
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


class PcssSettings(SoftShadowSettings):
    """Settings of percentage-closer soft shadows."""

    map_resolution: int = setting(1024, "texels across a shadow map", unit="px", source="Fernando 2005", ge=8, le=4096)
    taps: int = setting(32, "taps along each side of the filter", source="Fernando 2005", ge=1, le=64)


class PercentageCloserSoftShadows(SoftShadows):
    """Soft shadows of area lights guessed from one shadow map."""

    name = "pcss"
    title = "Percentage-closer soft shadows"
    source = "Fernando 2005"
    Settings = PcssSettings
    how_area = "the penumbra is that of one mean blocker seen from the light's centre"
    horizon = False

    def warm_up(self) -> None:
        """Import the kernels."""
        import renderers.transport.penumbra.filtered  # noqa: F401

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """One map per light."""
        from renderers.transport.penumbra.filtered import filtered_maps, soft

        maps = filtered_maps(world, emitters, points, settings.map_resolution, settings.near, counters, central=True)
        kernel = soft(settings.bias, settings.taps)
        return lambda k, positions, normals: maps[k].hidden(positions, normals, kernel)


register(PercentageCloserSoftShadows)
