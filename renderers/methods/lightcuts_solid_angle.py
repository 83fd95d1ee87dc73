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

from abc import abstractmethod
from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame
from renderers.method import Context, Method, Settings, Transport, register, setting
from renderers.methods.ir import InstantRadiosity, clamp_of, direct_layer, make_gbuffer, timed
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


class TreeMethod(Method):
    """Direct light plus one bounce through a tree of virtual lights; subclasses say how a pixel walks the tree."""

    claims: ClassVar = InstantRadiosity.claims

    def transport(self, settings: Any) -> Transport:
        """One bounce; without occlusion of the indirect segment unless `visibility` is raycast."""
        return "one-bounce" if settings.visibility == "raycast" else "one-bounce-unoccluded"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in `eps_b` from the scene's radius."""
        return settings.model_copy(update={"eps_b": clamp_of(scene, settings.eps_b)})

    @abstractmethod
    def _walk(
        self,
        world: World,
        gbuffer: GBuffer,
        tree: LightTree,
        settings: Any,
        seed: int,
        counters: Counter[str],
        caster: RayCaster | None,
    ) -> NDArray[np.float32]:
        """Light of the tree at every pixel, float32 (H, W, 3), shadow-tested if there is a caster."""

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            from renderers.transport.light_tree import build
            from renderers.transport.raycast import caster_of
            from renderers.transport.tree_gather import warm_up
            from renderers.transport.vpl import emit_vpls

            caster = caster_of(world)
            warm_up()
        with watch("vpls"):
            vpls = emit_vpls(world, settings.vpls, context.seed, settings.sampler, settings.light_samples, counters)
        with watch("tree"):
            tree = build(vpls)
        direct = np.zeros((context.size[1], context.size[0], 3), np.float64)
        indirect = np.zeros_like(direct)
        k = settings.subpixels
        for index in range(k * k):
            seed = context.seed + (index << 32)
            with watch("gbuffer"):
                gbuffer = make_gbuffer(world, context.size, ((index % k + 0.5) / k, (index // k + 0.5) / k), "cpu")
            with timed(watch, "direct", "render", settings.direct_visibility == "shadow-map"):
                direct += direct_layer(world, gbuffer, settings, seed, counters)
            with watch("cuts"):
                indirect += self._walk(
                    world, gbuffer, tree, settings, seed, counters, caster if settings.visibility == "raycast" else None
                )
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        layers = {"direct": (direct / k**2).astype(np.float32), "indirect": (indirect / k**2).astype(np.float32)}
        layers["beauty"] = layers["direct"] + layers["indirect"]
        return Frame(layers, watch.timings, dict(sorted(counters.items())), {"backend": "cpu"})


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

    def _walk(
        self,
        world: World,
        gbuffer: GBuffer,
        tree: LightTree,
        settings: Any,
        seed: int,
        counters: Counter[str],
        caster: RayCaster | None,
    ) -> NDArray[np.float32]:
        from renderers.transport.tree_gather import gather_solid_angle

        area, eps_b = float(world.areas.sum()) / settings.vpls, settings.eps_b * world.scale**2
        return gather_solid_angle(gbuffer, world, tree, area, settings.epsilon_omega, eps_b, counters, caster)


register(SolidAngleCuts)
