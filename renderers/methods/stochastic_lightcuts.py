"""Stochastic lightcuts (Yuksel 2019): a cut through a tree of virtual lights, each node shaded by one light sampled below it.

    L(x) = Σ_{nodes of the cut} f_r G_b(x, y_j) · I_j / p_j         j found by descending; E over j is the node's whole light

p of a child ∝ intensity × bounds of both cosines / distance², averaged over the least and the greatest distance to its box. The cut
starts at the roots; the node of the greatest error bound (intensity × cosine bounds / max(ε_b, least distance²); lightcuts,
Walter et al. 2005) is split next. Unbiased as `ir` is with the same ε_b, for any cut: what remains is noise of each pixel. Passes:
vpls, tree, gbuffer, direct, cuts.

| setting           | default          | unit | range                    | meaning                                           |
| ----------------- | ---------------- | ---- | ------------------------ | ------------------------------------------------- |
| vpls              | 8192             | 1    | 1 … 2²⁴                  | N, points on the surfaces                         |
| cut_size          | 32               | 1    | 1 … 4096                 | most nodes of a cut, and light samples a pixel    |
| tolerance         | 0.02             | 1    | 0 … 1                    | nodes under this share of all bounds stay         |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                      | clamp on the squared distance, the same as `ir`'s |
| visibility        | none             |      | none, raycast            | occlusion between receiver and light              |
| sampler           | uniform          |      | uniform, low-discrepancy | of the points                                     |
| light_samples     | 16               | 1    | 1 … 4096                 | samples of area lights and sky, per pixel and VPL |
| direct_visibility | raycast          |      | raycast, shadow-map      | shadows of the direct layer                       |
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderers.method import register, setting
from renderers.methods.lightcuts_solid_angle import TreeMethod, TreeSettings, caster_for
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.light_tree import LightTree


class StochasticSettings(TreeSettings):
    """Settings of stochastic lightcuts."""

    cut_size: int = setting(32, "most nodes of a cut, and light samples a pixel", source="Yuksel 2019 §4", ge=1, le=4096)
    tolerance: float = setting(
        0.02, "nodes whose error bound is under this share of all bounds aren't split", source="Walter et al. 2005", ge=0, le=1
    )


class StochasticLightcuts(TreeMethod):
    """Hierarchical importance sampling of virtual lights, one light for each node of a cut."""

    name = "stochastic-lightcuts"
    title = "Stochastic lightcuts"
    source = "Yuksel 2019; Walter et al. 2005"
    Settings = StochasticSettings

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: LightTree, settings: Any, seed: int,
        counters: Counter[str],
    ) -> NDArray[np.float32]:  # fmt: skip
        """One sampled light of each node of each pixel's cut."""
        from renderers.transport.tree_gather import gather_stochastic

        eps_b = settings.eps_b * world.scale**2
        caster = caster_for(world, settings)
        return gather_stochastic(gbuffer, world, made, settings.cut_size, settings.tolerance, seed, eps_b, counters, caster)


register(StochasticLightcuts)
