"""Screen-space directional occlusion (Ritschel, Grosch & Seidel 2009): what the camera sees blocks the sky and sends the bounce.

    L(P) = L_e + L_lights + Σ_i f_r cos θ_i L_sky(ω_i) (1 - B_i) 2π/N                                    (directional occlusion)
         + Σ_i f_r L_Q B_i cos θ_P cos θ_Q / max(ε, |PQ|²) · π r_max²/N                                 (one indirect bounce)

N samples P + λ_i ω_i about each pixel, λ_i ≤ r_max; B_i = 1 where the surface Q seen in the sample's own pixel lies before it.
Lamps and the sun are lit with their own shadows, as published. Nothing off the screen or hidden blocks or sends light, and each
sender is taken for π r_max²/N of surface whatever it is: colour bleeds from near and visible surfaces alone, and changes with the
camera. ε is at least r_max²/N, so that a sender brings no more than a hemisphere of its radiance. Blocks of pixels share samples
through an edge-aware filter. Passes: gbuffer, direct (with the sky), bounce.

| setting           | default          | unit | range               | meaning                                                      |
| ----------------- | ---------------- | ---- | ------------------- | ------------------------------------------------------------ |
| radius            | 0.2              | r    | 0 … 2               | r_max in scene radii                                         |
| samples           | 32               | 1    | 1 … 1024            | N                                                            |
| block             | 4                | px   | 1, 2, 4, 8          | side of the blocks that share samples; 1: no filter          |
| bias              | 0.05             | 1    | 0 … 1               | least sine of a blocker's height over the receiver's horizon |
| sky_visibility    | screen           |      | screen, raycast     | shadows of the environment                                   |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                 | clamp on the squared distance, r_max²/N at least             |
| light_samples     | 16               | 1    | 1 … 4096            | samples of area lights (and of a ray-cast sky), per pixel    |
| direct_visibility | raycast          |      | raycast, shadow-map | shadows of lamps and sun                                     |
| backend           | auto             |      | auto, gl, cpu       | auto: a fixed table on the device string                     |
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.method import Claim, Context, Transport, register, setting
from renderers.methods.ir import InstantRadiosity
from renderers.methods.one_bounce import OneBounce, OneBounceSettings, direct_layer, make_gbuffer
from renderers.scene.model import Scene
from renderers.scene.world import LAMBERT, World, rest_bounds

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.screen_space import Search

PAPER = "Ritschel, Grosch & Seidel 2009"


class SsdoSettings(OneBounceSettings):
    """Settings of screen-space directional occlusion."""

    radius: float = setting(0.2, "r_max, farthest sample, in scene radii", unit="r", source=f"{PAPER} §3", gt=0, le=2)
    samples: int = setting(32, "N, samples per pixel", source=f"{PAPER} §3", ge=1, le=1024)
    block: Literal[1, 2, 4, 8] = setting(
        4, "side of the blocks of pixels that share samples; 1: no filter", unit="px", source=PAPER
    )
    bias: float = setting(0.05, "least sine of a blocker's height over the receiver's horizon", ge=0, le=1)
    sky_visibility: Literal["screen", "raycast"] = setting("screen", "shadows of the environment", source=f"{PAPER} §3")


class Made(NamedTuple):
    """What a frame prepares: how pixels search, and the World of lamps and sun without the sky."""

    search: Search
    lamps: World


class ScreenSpaceOcclusion(OneBounce):
    """Sky and bounce from what the camera sees near each pixel."""

    name = "ssdo"
    title = "Screen-space directional occlusion"
    source = PAPER
    pass_name = "bounce"
    Settings = SsdoSettings
    claims: ClassVar = {
        **InstantRadiosity.claims,
        "diffuse": Claim("approximated", "bounces light of visible surfaces within the radius alone, whose size is assumed"),
        "environment": Claim("approximated", "is blocked by visible surfaces within the radius alone"),
    }

    def transport(self, settings: Any) -> Transport:
        """One bounce: a sender is what the receiver sees first, as far as the camera can tell."""
        return "one-bounce"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """As for every such method; and no sender nearer than where it would cover the hemisphere."""
        resolved = super().resolve(scene, settings, device)
        least = (settings.radius * rest_bounds(scene)[1]) ** 2 / settings.samples
        return resolved.model_copy(update={"eps_b": max(resolved.eps_b, least)})

    def warm_up(self, world: World, settings: Any) -> None:
        """Both passes for one block of pixels."""
        from renderers.transport.screen_space import Search, sample_pattern

        search = Search(sample_pattern(1, settings.block, 0), settings.radius, settings.bias)
        gbuffer = make_gbuffer(world, (8, 8), (0.5, 0.5), settings.backend)
        self.filtered(world, gbuffer, search, settings, None)
        self.filtered(world, gbuffer, search, settings, np.zeros((8, 8, 3), np.float32))

    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> Made:
        """The pattern of samples; and a ray caster for the World without sky where a screen-space one takes its place."""
        from renderers.transport.raycast import caster_of
        from renderers.transport.screen_space import Search, sample_pattern

        lamps = world
        if world.environment is not None and settings.sky_visibility == "screen":
            lamps = replace(world, environment=None)
            if world.lights or len(world.emissive):
                with context.watch("lamps", "prepare"):
                    caster_of(lamps)
        return Made(Search(sample_pattern(settings.samples, settings.block, context.seed), settings.radius, settings.bias), lamps)

    def direct(
        self, world: World, gbuffer: GBuffer, made: Made, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Lamps and sun with their shadows, background, and the sky as far as visible surfaces leave it open."""
        if made.lamps is world:
            return direct_layer(world, gbuffer, settings, seed, counters)
        from renderers.transport.direct import emitted

        lit = direct_layer(made.lamps, gbuffer, settings, seed, counters)
        lit = lit + emitted(world, gbuffer) - emitted(made.lamps, gbuffer)
        counters["screen_samples"] += int(np.count_nonzero(gbuffer.covered)) * settings.samples
        return lit + self.filtered(world, gbuffer, made.search, settings, None)

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: Made, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Reflected light of visible pixels, without what they emit: a lamp's light is direct light already."""
        counters["screen_samples"] += int(np.count_nonzero(gbuffer.covered)) * settings.samples
        return self.filtered(world, gbuffer, made.search, settings, lit - gbuffer.emission)

    def filtered(
        self, world: World, gbuffer: GBuffer, search: Search, settings: Any, senders: NDArray[np.float32] | None
    ) -> NDArray[np.float32]:
        """The sky (no senders) or the bounce; joined over blocks before the product with a Lambertian's albedo."""
        from renderers.transport.interleave import joined

        lambert = gbuffer.covered & (world.materials.kind[gbuffer.material] == LAMBERT)
        white = replace(gbuffer, base=np.where(lambert[..., None], np.float32(1), gbuffer.base))
        image = passed(world, white, search, settings, senders)
        if settings.block > 1:
            image = joined(image, gbuffer, settings.block)
        return image * np.where(lambert[..., None], gbuffer.base, np.float32(1))


def passed(
    world: World, gbuffer: GBuffer, search: Search, settings: Any, senders: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """One pass on the resolved backend, float32 (H, W, 3)."""
    eps_b = settings.eps_b * world.scale**2
    if settings.backend == "gl":
        from renderers.gl import screen_space as on_gl

        return on_gl.sky(gbuffer, world, *search) if senders is None else on_gl.bounce(gbuffer, world, *search, senders, eps_b)
    from renderers.transport import screen_space as on_cpu

    return on_cpu.sky(gbuffer, world, search) if senders is None else on_cpu.bounce(gbuffer, world, search, senders, eps_b)


register(ScreenSpaceOcclusion)
