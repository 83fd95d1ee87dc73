"""Moment soft shadow map (Peters & Klein 2015; Peters et al. 2017): one shadow map, summed up, filtered as wide as the penumbra.

    b_k = mean of z^k over a window, k = 1 … 4           V = least weight before z_f of any distribution of depths with these
    moments

The windows are those of `pcss`: what the light covers of the near plane finds the mean blocker, the width of its penumbra the
share. Each is four reads of a summed-area table, whatever its size. Light leaks where depths in a window spread (several blockers
over one another). Settings: those of `soft_shadows`, and moment_bias.
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


class MomentShadowMapSettings(SoftShadowSettings):
    """Settings of the moment soft shadow map."""

    map_resolution: int = setting(1024, "texels across a shadow map", unit="px", source="Peters et al. 2017", ge=8, le=4096)
    bias: float = setting(
        5e-3, "subtracted from the receiver's depth, in scene radii", unit="r", source="Peters & Klein 2015", ge=0, le=1
    )
    moment_bias: float = setting(
        1e-6, "share of an uncertain distribution mixed in against rounding", source="Peters & Klein 2015 §4.2", ge=1e-12, le=0.1
    )


class MomentShadowMap(SoftShadows):
    """Soft shadows of area lights from moments of one shadow map."""

    name = "moment-shadow-map"
    title = "Moment soft shadow map"
    source = "Peters & Klein 2015; Peters et al. 2017"
    Settings = MomentShadowMapSettings
    how_area = "the penumbra is that of one mean blocker seen from the light's centre, bounded from below by four moments of depth"
    horizon = False

    def warm_up(self) -> None:
        """Import the kernels."""
        import renderers.transport.penumbra.moments  # noqa: F401

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """One summed map per light."""
        from renderers.transport.penumbra.filtered import filtered_maps
        from renderers.transport.penumbra.moments import moment_soft, summed_moments

        maps = filtered_maps(
            world, emitters, points, settings.map_resolution, settings.near, counters, central=True, prefilter=summed_moments
        )
        kernel = moment_soft(settings.bias, settings.moment_bias)
        return lambda k, positions, normals: maps[k].hidden(positions, normals, kernel)


register(MomentShadowMap)
