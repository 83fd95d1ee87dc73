"""Backward light cuts by solid angle: the deterministic twin of `flc`, from a tree over the same virtual lights.

    cut of x: open a node of area a while a ⟨n_y, yx⟩⁺ / r² > ε_Ω;      L(x) = Σ_cut f_r G_b(x, ȳ) · ΣI

Laurent 2018, equations 4.6 and 4.8, figures 3.7 and 4.1 (the cut of point-based global illumination, Christensen 2008). The test is
conservative: r² is the distance to the node's box, the cosine a bound over the node. Its error is a bias that falls with ε_Ω, at
ε_Ω → 0 the image is that of `ir`. Passes: vpls, tree, gbuffer, direct, cuts.

| setting           | default          | unit | range                    | meaning                                             |
| ----------------- | ---------------- | ---- | ------------------------ | --------------------------------------------------- |
| vpls              | 8192             | 1    | 1 … 2²⁴                  | N, points on the surfaces                           |
| epsilon_omega     | 0.05             | sr   | > 0                      | solid angle above which a node is opened            |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                      | clamp on the squared distance, the same as `ir`'s   |
| visibility        | none             |      | none, raycast            | occlusion between receiver and node                 |
| sampler           | uniform          |      | uniform, low-discrepancy | of the points                                       |
| light_samples     | 16               | 1    | 1 … 4096                 | samples of area lights and sky, per pixel and VPL   |
| direct_visibility | raycast          |      | raycast, shadow-map      | shadows of the direct layer                         |
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.method import Context, Settings, Transport, register, setting
from renderers.methods.ir import InstantRadiosity
from renderers.methods.one_bounce import OneBounce, clamp_of
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.light_tree import LightTree
    from renderers.transport.raycast import RayCaster


class TreeSettings(Settings):
    """Settings that all methods on a tree of virtual lights share."""

    vpls: int = setting(8192, "N, number of points drawn on the surfaces", source="Laurent 2018 eq. 4.2", ge=1, le=1 << 24)
    eps_b: float | None = setting(
        None,
        "clamp on the squared distance; empty: (1 % of the scene's radius)²; 0: no clamp",
        unit="m²",
        source="Laurent 2018 eq. 2.19",
        ge=0,
    )
    visibility: Literal["none", "raycast"] = setting("none", "occlusion between receiver and light", source="Laurent 2018 §2.3")
    sampler: Literal["uniform", "low-discrepancy"] = setting("uniform", "independent points or an Owen-scrambled Sobol' set")
    light_samples: int = setting(16, "samples of area lights and environment, per pixel and per virtual light", ge=1, le=4096)
    direct_visibility: Literal["raycast", "shadow-map"] = setting("raycast", "shadows of the direct layer")


class TreeMethod(OneBounce):
    """Direct light plus one bounce through a tree of virtual lights; subclasses say how a pixel walks the tree."""

    pass_name = "cuts"
    claims: ClassVar = InstantRadiosity.claims

    def transport(self, settings: Any) -> Transport:
        """One bounce; without occlusion of the indirect segment unless `visibility` is raycast."""
        return "one-bounce" if settings.visibility == "raycast" else "one-bounce-unoccluded"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in `eps_b` from the scene's radius."""
        return settings.model_copy(update={"eps_b": clamp_of(scene, settings.eps_b)})

    def warm_up(self, world: World, settings: Any) -> None:
        """Kernels of tree and cuts."""
        from renderers.transport.tree_gather import warm_up

        warm_up()

    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> LightTree:
        """The virtual lights, and the tree over them."""
        from renderers.transport.light_tree import build
        from renderers.transport.vpl import emit_vpls

        with context.watch("vpls"):
            vpls = emit_vpls(world, settings.vpls, context.seed, settings.sampler, settings.light_samples, counters)
        with context.watch("tree"):
            return build(vpls)


def caster_for(world: World, settings: Any) -> RayCaster | None:
    """The World's ray caster, where nodes of the cut are tested for shadows."""
    from renderers.transport.raycast import caster_of

    return caster_of(world) if settings.visibility == "raycast" else None


class SolidAngleSettings(TreeSettings):
    """Settings of backward light cuts by solid angle."""

    epsilon_omega: float = setting(
        0.05, "solid angle above which a node is opened", unit="sr", source="Laurent 2018 eq. 4.8", gt=0, le=100
    )


class SolidAngleCuts(TreeMethod):
    """A cut through a tree of virtual lights for each pixel, by solid angle."""

    name = "lightcuts-solid-angle"
    title = "Backward light cuts by solid angle"
    source = "Laurent 2018 §4.2.1; Christensen 2008"
    Settings = SolidAngleSettings

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: LightTree, settings: Any, seed: int,
        counters: Counter[str],
    ) -> NDArray[np.float32]:  # fmt: skip
        """The lights of each pixel's cut."""
        from renderers.transport.tree_gather import gather_solid_angle

        area, eps_b = float(world.areas.sum()) / settings.vpls, settings.eps_b * world.scale**2
        caster = caster_for(world, settings)
        return gather_solid_angle(gbuffer, world, made, area, settings.epsilon_omega, eps_b, counters, caster)


register(SolidAngleCuts)
