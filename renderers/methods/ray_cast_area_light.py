"""Ray-cast area light: the hidden share by shadow rays to N stratified points of the light, the same ones at every pixel.

    V(P) = 1/N Σ_i [segment from P to s_i is blocked]

With the light points of `pdsm` and `averaged-shadow-maps` (same samples and seed) it is what those two approximate by maps; with
many points only the separation of light and visibility is left as error. Settings: those of `soft_shadows`; bias, near and
map_resolution don't matter.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from renderers.method import register
from renderers.methods.soft_shadows import SoftShadows, SoftShadowSettings
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.shading import F64, Hidden


class RayCastAreaLight(SoftShadows):
    """Soft shadows of area lights by shadow rays, separated from the light they carry."""

    name = "ray-cast-area-light"
    title = "Ray-cast area light"
    source = "St-Amour 2004 §2.1"
    Settings = SoftShadowSettings
    how_area = "the hidden share weighs all parts of a light alike, from a fixed set of points"

    def warm_up(self) -> None:
        """The caster is all there is, and `soft_shadows` builds it."""

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """Nothing is built: every point is left to the shadow rays."""
        return lambda k, positions, normals: np.full(len(positions), -1, np.float32)


register(RayCastAreaLight)
