"""Forward light cuts (Laurent 2018): one diffuse bounce, where each virtual light draws at birth how far it acts.

    α_y(x) = r³ / ⟨n_y, x-y⟩        κ ~ μ        T(x) = Σ_n s_κ(α_n(x)) / μ_κ · f_r G_b(x, y_n) · I_n        E[s_κ/μ_κ] = 1

Equations 4.13, 4.16, 4.18 and 4.26, algorithms 1 to 5; α in squared reaches (ε_Ω = 1). Numerous lights act near only, rare ones
far and strongly; nothing is built. In the mean the image is that of `ir` with the same clamp, which is the only bias besides
ignoring V; at equal N it is noisier and cheaper. The published families of levels are c0 (the publication's choice), c-1, linear
and ridge. The default, roulette, has the least variance × cost (docs/methods/flc.md derives it): a light of intensity I survives
at α with probability min(1, a_1 I / (Ī α)). K = 1 is `ir`, to the byte. Passes: vpls (points, light, levels), gbuffer, direct,
splat (with the filter where interleaved).

| setting           | default          | unit | range                    | meaning                                              |
| ----------------- | ---------------- | ---- | ------------------------ | ---------------------------------------------------- |
| quality           | 0.5              | 1    | 0 … 1                    | N = 1024 · 64^quality                                |
| reach             | 0.3              | 1    | > 0                      | R_1 over the radius: where lights begin to thin out  |
| vpls              | from quality     | 1    | 1 … 2²⁴                  | N                                                    |
| family            | roulette         |      | and c0, c-1, linear,     | support functions: docs, (4.18), (4.17), (4.45),     |
|                   |                  |      | ridge                    | (4.47)                                               |
| levels            | from reach       | 1    | 1 … 32                   | K: R_K ≥ the radius, and 32 VPLs or more at the last |
| q_a               | 2                | 1    | > 1                      | ratio of areas of neighbouring levels; not roulette  |
| q_n               | q_a              | 1    | > 1                      | ratio of their numbers; not roulette                 |
| epsilon_omega     | from reach       | sr   | > 0                      | reach unset: R_1² = area / (N μ_1 ε_Ω)               |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                      | clamp on the squared distance, the same as `ir`'s    |
| visibility        | none             |      | none, raycast            | occlusion between VPL and receiver                   |
| passes            | 1                | 1    | 1 … 4096                 | progressive: average of draws of N VPLs              |
| interleave        | 1                | 1    | 1, 2, 4, 8               | s: each VPL in one of s² sub-images, then a filter   |
| sampler, eta      | low-discrepancy  |      | uniform, resampled       | of the points, as `ir`, and of the levels            |
| light_samples     | 16               | 1    | 1 … 4096                 | samples of area lights and sky, per pixel and VPL    |
| direct_visibility | raycast          |      | raycast, shadow-map      | shadows of the direct layer                          |
| backend           | auto             |      | auto, gl, cpu            | auto: a fixed table on the device string             |
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.method import Context, register, setting
from renderers.methods.flc_levels import calibrate, family_of, notes_of
from renderers.methods.ir import InstantRadiosity, IrSettings, eta_of, gather_vpls, light_of, resampled
from renderers.methods.one_bounce import backend_of, clamp_of
from renderers.scene.model import Scene
from renderers.scene.world import LAMBERT, World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.cuts import Family
    from renderers.transport.resampling.points import Points
    from renderers.transport.vpl import Vpls

WHOLE = 4.0
CHAPTER = "Laurent 2018 §4.2"


class FlcSettings(IrSettings):
    """Settings of forward light cuts. quality and reach are enough; the others override what follows from them."""

    quality: float = setting(0.5, "sets the number of virtual lights: N = 1024 · 64^quality", ge=0, le=1)
    reach: float | None = setting(
        None,
        "R_1 over the scene's radius: where lights begin to thin out; empty: 0.3; from 1 on K = 1",
        source=CHAPTER,
        gt=0,
        le=1e3,
    )
    vpls: int | None = setting(  # type: ignore[assignment]
        None, "N, number of points drawn on the surfaces; empty: from quality", source="Laurent 2018 eq. 4.26", ge=1, le=1 << 24
    )
    family: Literal["roulette", "c0", "c-1", "linear", "ridge"] = setting(
        "roulette",
        "support functions: roulette, or published: C⁰ hats, C⁻¹ steps, hats prolonged linearly, the logarithmic ridge",
        source="Laurent 2018 §4.2-4.3; roulette: docs/methods/flc.md",
    )
    sampler: Literal["uniform", "low-discrepancy", "resampled"] = setting(
        "low-discrepancy",
        "of points and levels: independent, an Owen-scrambled Sobol' set, or triangle by triangle at constant density",
        source="Laurent 2018 chapter 5",
    )
    levels: int | None = setting(None, "K, number of levels; empty: from reach", source=CHAPTER, ge=1, le=32)
    q_a: float = setting(2.0, "ratio of the areas of neighbouring levels", source="Laurent 2018 eq. 4.28", gt=1, le=100)
    q_n: float | None = setting(
        None, "ratio of the numbers of lights of neighbouring levels; empty: q_a", source="Laurent 2018 eq. 4.19", gt=1, le=100
    )
    epsilon_omega: float | None = setting(
        None, "solid angle of the cut; sets the reach where that is empty", unit="sr", source="Laurent 2018 eq. 4.8", gt=0, le=100
    )
    passes: int = setting(1, "progressive: average of this many draws of N lights", source="Laurent 2018 §5.6", ge=1, le=4096)
    interleave: Literal[1, 2, 4, 8] = setting(1, "s: each light goes to one of s² sub-images", source="Laurent 2018 §5.6.4")


class Draw(NamedTuple):
    """One draw of VPLs: the lit ones, their levels, and the rows that kernels and shader read."""

    vpls: Vpls
    rows: NDArray[np.float32]
    place: NDArray[np.int64]


class Made(NamedTuple):
    """What a frame prepares: the support functions, and a draw of virtual lights for each pass."""

    family: Family
    draws: list[Draw]


class ForwardLightCuts(InstantRadiosity):
    """Direct light plus one diffuse bounce through virtual lights of random, bounded reach."""

    name = "flc"
    title = "Forward light cuts"
    source = "Laurent 2018 chapter 4; Laurent et al. 2016"
    pass_name = "splat"
    Settings = FlcSettings
    claims: ClassVar = InstantRadiosity.claims

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in N, the levels, the clamp and the backend; resolving twice changes nothing."""
        c = calibrate(scene, settings)
        return settings.model_copy(
            update={
                "vpls": c.vpls,
                "reach": c.reach,
                "levels": c.levels,
                "q_n": c.q_n,
                "epsilon_omega": c.epsilon_omega,
                "eps_b": clamp_of(scene, settings.eps_b),
                "eta": eta_of(scene, settings.model_copy(update={"vpls": c.vpls})),
                "backend": backend_of(settings.backend, settings.visibility, device),
            }
        )

    def warm_up(self, world: World, settings: Any) -> None:
        """What `ir` warms up, and the splatting kernels or shader."""
        super().warm_up(world, settings)
        if not is_ir(settings):
            warm_up_splat(world, settings)

    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> Made:
        """The virtual lights of all passes, with their levels."""
        family = family_of(scene, settings)
        points = [resampled(world, settings, context.seed, context.watch, p) for p in range(settings.passes)]
        with context.watch("vpls"):
            draws = [draw(world, family, settings, context.seed + (p << 48), counters, points[p]) for p in range(settings.passes)]
        return Made(family, draws)

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: Made, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Mean of the passes."""
        images = [splat_draw(world, gbuffer, d, made.family, settings, counters) for d in made.draws]
        return np.asarray(sum(images) / len(images), np.float32)

    def notes(self, scene: Scene, settings: Any) -> tuple[str, ...]:
        """What the levels were cut down to."""
        return notes_of(scene, settings)


def is_ir(settings: Any) -> bool:
    """Whether every weight is 1: one discrete level, no sub-images."""
    return settings.levels == 1 and settings.family not in ("linear", "ridge") and settings.interleave == 1


def warm_up_splat(world: World, settings: Any) -> None:
    """Compile the splatting kernels or shader."""
    kernel = {"linear": 1, "ridge": 2, "roulette": 3}.get(settings.family, 0)
    if settings.backend == "gl":
        from renderers.gl.cuts import warm_up as compile_shaders

        compile_shaders(world, kernel)
        return
    from renderers.transport.splat import warm_up as compile_splat

    compile_splat(kernel, settings.visibility == "raycast" or bool((world.materials.kind != LAMBERT).any()))


def draw(world: World, family: Family, settings: Any, seed: int, counters: Counter[str], points: Points | None = None) -> Draw:
    """VPLs of one seed, those of `ir`, with a level and a sub-image each, drawn independently of all else.

    Low-discrepancy levels are the dimension of the points' Sobol' sequence after theirs, scrambled on its own: lights near one
    another differ in level, so that each level alone is well spread too. Resampled points bring the numbers of both along: the
    level's is what the draw of the point left over (5.12, 5.23).
    """
    from renderers.transport.sampling import generator, uniform_numbers
    from renderers.transport.splat import light_rows

    vpls = light_of(world, points, settings, seed, counters)
    family = family.among(vpls.intensities)
    levels = generator(seed, "levels")
    if vpls.numbers is not None:
        marks = family.draw(vpls.numbers[:, 0])
        place = (vpls.numbers[:, 1] * settings.interleave**2).astype(np.int64)
    else:
        independent = settings.sampler == "uniform"
        numbers = levels.random(vpls.drawn) if independent else uniform_numbers(vpls.drawn, 4, levels, settings.sampler)[:, 3]
        marks = family.draw(numbers[vpls.index])
        place = generator(seed, "sub-images").integers(settings.interleave**2, size=vpls.drawn)[vpls.index]
    for level, count in zip(*np.unique(marks.astype(np.int64), return_counts=True), strict=True):
        counters[f"vpls_level_{level}"] += int(count)
    return Draw(vpls, light_rows(vpls, family, marks), place)


def splat_draw(
    world: World, gbuffer: GBuffer, drawn: Draw, family: Family, settings: Any, counters: Counter[str]
) -> NDArray[np.float32]:
    """Light of one draw at every pixel, float32 (H, W, 3)."""
    if is_ir(settings):
        return gather_vpls(world, gbuffer, drawn.vpls, settings, counters)
    if settings.interleave == 1:
        return splat_rows(world, gbuffer, drawn.rows, family, settings, counters)
    return interleaved(world, gbuffer, drawn, family, settings, counters)


def interleaved(
    world: World, gbuffer: GBuffer, drawn: Draw, family: Family, settings: Any, counters: Counter[str]
) -> NDArray[np.float32]:
    """Each light in its sub-image alone, s² times as strong; then the filter, before the product with a Lambertian's albedo."""
    from dataclasses import replace

    from renderers.transport.interleave import joined, sub_images

    side = settings.interleave
    lambert = gbuffer.covered & (world.materials.kind[gbuffer.material] == LAMBERT)
    white = replace(gbuffer, base=np.where(lambert[..., None], np.float32(1), gbuffer.base))
    rows = drawn.rows.copy()
    rows[6:9] *= side * side
    image = np.empty((*gbuffer.triangle.shape, 3), np.float32)
    for index, (place, part) in enumerate(sub_images(white, side)):
        here = np.ascontiguousarray(rows[:, drawn.place == index])
        image[place] = splat_rows(world, part, here, family, settings, counters)
    return joined(image, gbuffer, side) * np.where(lambert[..., None], gbuffer.base, np.float32(1))


def splat_rows(
    world: World, gbuffer: GBuffer, rows: NDArray[np.float32], family: Family, settings: Any, counters: Counter[str]
) -> NDArray[np.float32]:
    """One splatting pass on the resolved backend, float32 (H, W, 3)."""
    eps_b = settings.eps_b * world.scale**2
    if settings.backend == "gl":
        from renderers.gl.cuts import splat_cuts

        image, computed, touched = splat_cuts(gbuffer, world, rows, spheres_of(rows), family.kernel, eps_b)
        counters["light_evaluations"] += computed
        counters["pixels_touched"] += touched
        return image
    from renderers.transport.raycast import caster_of
    from renderers.transport.splat import splat

    caster = caster_of(world) if settings.visibility == "raycast" else None
    return splat(gbuffer, world, rows, family, eps_b, caster, counters)


def spheres_of(rows: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Spheres around the supports, a little wider than they; one around the whole World, of radius 1, where that is smaller."""
    from renderers.transport.cuts import enclosing_spheres

    wide = rows.astype(np.float64)
    centres, radii = enclosing_spheres(wide[:3].T, wide[3:6].T, wide[10])
    endless = radii > WHOLE
    return np.where(endless[:, None], wide[:3].T, centres), np.where(endless, WHOLE, radii * 1.0001 + 1e-6)


register(ForwardLightCuts)
