"""Reflective shadow maps (Dachsbacher & Stamminger 2005): what each light sees first re-emits its light, gathered in a disc.

    Φ_p = ρ(y_p) · I(ω) dω        L(x) = L_e + L_direct + Σ_{p ∈ disc(x)} w_p · f_r ⟨n_x, l⟩⁺ ⟨n_p, -l⟩⁺ / max(ε_b, r²) · Φ_p / π

Each light renders a map of positions, normals and reflected flux; a pixel looks up `samples` texels in a disc around its own place
in the map, crowded at the centre, each weighted by the share of the disc that it stands for (weights = published: the printed ξ²).
Without occlusion, as published; light of texels outside the disc is lost, so a wide enough disc (`radius` 0.5 for point and spot
lights, 1 for area lights, 1.42 for directional ones) has the mean of `ir`. Passes: maps, gbuffer, direct, gather.

| setting           | default          | unit | range               | meaning                                                      |
| ----------------- | ---------------- | ---- | ------------------- | ------------------------------------------------------------ |
| map_resolution    | 256              | px   | 8 … 4096            | texels across a tile; a point light has six tiles            |
| samples           | 400              | 1    | 1 … 65536           | texels looked up per pixel and map                           |
| radius            | 0.3              | 1    | 0 … 16              | of the disc, in widths of the map                            |
| weights           | area             |      | area, published     | Jacobian of the polar samples, or the printed ξ²             |
| map_lights        | 4                | 1    | 1 … 256             | points with a map on all area lights, and as many of the sky |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                 | clamp on the squared distance, the same as `ir`'s            |
| light_samples     | 16               | 1    | 1 … 4096            | samples of area lights and sky, per pixel                    |
| direct_visibility | raycast          |      | raycast, shadow-map | shadows of the direct layer                                  |
| backend           | auto             |      | auto, gl, cpu       | auto: a fixed table on the device string                     |
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.method import Claim, Context, register, setting
from renderers.methods.ir import InstantRadiosity
from renderers.methods.one_bounce import OneBounce, OneBounceSettings, make_gbuffer, timed
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.reflective import LightView, ReflectiveMap

PAPER = "Dachsbacher & Stamminger 2005"


class RsmSettings(OneBounceSettings):
    """Settings of reflective shadow maps."""

    map_resolution: int = setting(256, "texels across a tile of a map; a point light has six tiles", unit="px", ge=8, le=4096)
    samples: int = setting(400, "texels looked up per pixel and map", source=f"{PAPER} §4", ge=1, le=65536)
    radius: float = setting(0.3, "of the disc of texels, in widths of the map", source=f"{PAPER} §4", gt=0, le=16)
    weights: Literal["area", "published"] = setting(
        "area", "share of the disc that a sample stands for, or the printed ξ²", source=f"{PAPER} §4"
    )
    map_lights: int = setting(4, "points with a map of their own on all area lights together, and as many of the sky", ge=1, le=256)


class ReflectiveShadowMaps(OneBounce):
    """One bounce off what the lights see, gathered from a disc of map texels."""

    name = "rsm"
    title = "Reflective shadow maps"
    source = PAPER
    pass_name = "gather"
    Settings = RsmSettings
    claims: ClassVar = {
        **InstantRadiosity.claims,
        "area_light": Claim("approximated", "bounces the light of `map_lights` points on all area lights together"),
        "environment": Claim("approximated", "bounces the light of `map_lights` directions of the sky"),
    }

    def warm_up(self, world: World, settings: Any) -> None:
        """A gather from a map of one texel for one pixel."""

        views = views_of(world, 1, 8)[:1]
        if views:
            seen = map_of(world, views[0], settings.backend)
            gather(world, make_gbuffer(world, (1, 1), (0.5, 0.5), settings.backend), seen, settings, 1, Counter())

    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> Any:
        """One map for each point-like light."""
        with timed(context.watch, "maps", "render", settings.backend == "gl"):
            maps = [map_of(world, v, settings.backend) for v in views_of(world, settings.map_lights, settings.map_resolution)]
        counters["map_texels"] += sum(m.flux.shape[0] * m.flux.shape[1] for m in maps)
        counters["maps"] += len(maps)
        return maps, context.seed

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: Any, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """The sum over all maps."""
        maps, seed = made
        total = np.zeros(lit.shape)
        for index, seen in enumerate(maps):
            total += gather(world, gbuffer, seen, settings, seed + (index << 32), counters)
        return total.astype(np.float32)


def views_of(world: World, lights: int, resolution: int) -> list[LightView]:
    """The views of all lights as point-like samples."""
    from renderers.gl.lights import light_samples
    from renderers.gl.shadow import light_view

    return [light_view(world, sample, resolution) for sample in light_samples(world, lights)]


def map_of(world: World, view: LightView, backend: str) -> ReflectiveMap:
    """What a light sees and reflects, by rasterisation or ray casting."""
    from renderers.transport.reflective import cast_map, reflective_map

    if backend == "gl":
        from renderers.gl.reflective import render_map

        return reflective_map(world, view, *render_map(world, view))
    return reflective_map(world, view, *cast_map(world, view))


def gather(
    world: World, gbuffer: GBuffer, seen: ReflectiveMap, settings: Any, seed: int, counters: Counter[str]
) -> NDArray[np.float32]:
    """Light of one map on the resolved backend, float32 (H, W, 3)."""
    from renderers.transport.reflective import disc_samples, gather_map

    samples = disc_samples(seen.view, settings.radius, settings.samples, seed, settings.weights)
    eps_b = settings.eps_b * world.scale**2
    if settings.backend == "gl":
        from renderers.gl.reflective import gather_map as gather_gl

        counters["light_evaluations"] += int(np.count_nonzero(gbuffer.covered)) * len(samples)
        return gather_gl(gbuffer, world, seen, samples, eps_b)
    return gather_map(gbuffer, world, seen, samples, eps_b, counters)


register(ReflectiveShadowMaps)
