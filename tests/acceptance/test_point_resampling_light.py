"""Dynamic point resampling: the light that the points send, check by check; T numbers are those of the specification.

Most run in the box of `toy_box`, whose levels are tied to the points: a_k = η_k, ε_Ω = 0.3 sr, ε_b = 0.01 m². What the points are
is checked in `test_point_resampling.py`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from toy_box import RADIUS, SURFACE, toy_box

from renderers.methods.flc import FlcSettings, ForwardLightCuts, draw, family_of, spheres_of
from renderers.methods.ir import InstantRadiosity, IrSettings
from renderers.transport.cuts import DROP_HEIGHT, DROP_WIDTH, DiscreteLevels, RidgeLevels, coordinate, geometric_levels
from renderers.transport.gather import gather
from renderers.transport.interleave import sub_images
from renderers.transport.primary import cast_gbuffer
from renderers.transport.resampling.points import progressive_shift, resample
from renderers.transport.sampling import generator, uniform_sphere
from renderers.transport.splat import splat
from renderers.transport.vpl import emit_vpls
from reports.metrics import Pair, rmse, ssim

METHOD, IR = ForwardLightCuts(), InstantRadiosity()
CPU = "llvmpipe (LLVM 15.0.6, 256 bits)"
SIZE, SMALL = (160, 120), (24, 18)
POINTS, LEVELS, EPSILON_OMEGA, EPS_B = 6000, 4, 0.3, 0.01
FRAMES = 512
TRUTH = 1 << 17


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """`auto` shall not ask for a GL context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: CPU)


def linked(vpls: int, **others: Any) -> FlcSettings:
    """Levels tied to the points: ε_Ω R_1² = η_1 = (|S| / N) / μ_1."""
    first = SURFACE / vpls / geometric_levels(LEVELS, 1.0, 2.0, 2.0)[1][0]
    reach = (first / EPSILON_OMEGA) ** 0.5 / RADIUS
    return FlcSettings(vpls=vpls, sampler="resampled", family="c0", levels=LEVELS, reach=reach, eps_b=EPS_B, **others)


def resolved(vpls: int = 3000) -> Any:
    return METHOD.resolve(toy_box(), linked(vpls), CPU)


def shifted(shifts: list[tuple[int, int]]) -> np.ndarray:
    """Indirect light of one seed's points with each of these shifts: green, float64 (len(shifts), P)."""
    world, settings = toy_box().world(), resolved()
    g, family, eta = cast_gbuffer(world, SMALL), family_of(toy_box(), settings), settings.eta * world.scale**2
    images = []
    for shift in shifts:
        rows = draw(world, family, settings, 1, Counter(), resample(world, eta, 1, shift)).rows
        images.append(splat(g, world, rows, family, EPS_B * world.scale**2)[g.covered][:, 1])
    return np.stack(images).astype(np.float64)


@cache
def progressive() -> np.ndarray:
    """Mean of the first 64 progressive draws, (P,)."""
    return np.asarray(shifted([progressive_shift(k) for k in range(64)]).mean(axis=0))


@cache
def frames() -> tuple[np.ndarray, np.ndarray]:
    """Indirect light with FRAMES random shifts, and the truth: green, (FRAMES, P) and (P,), float64."""
    world = toy_box().world()
    g = cast_gbuffer(world, SMALL)
    images = shifted([(int(a), int(b)) for a, b in generator(3, "shifts").integers(1 << 32, size=(FRAMES, 2))])
    vpls = emit_vpls(world, TRUTH, 5, "low-discrepancy", 1)
    light = gather(g, world, vpls.positions, vpls.normals, vpls.intensities, EPS_B * world.scale**2)
    return images, light[g.covered][:, 1].astype(np.float64)


@pytest.mark.parametrize("count", [1, 2, 4, 8, 32])
@pytest.mark.parametrize("ratio", [1.3, 2.0, 4.0])
@pytest.mark.parametrize("smooth", [True, False])
def test_t_20_partition_of_unity(count: int, ratio: float, smooth: bool) -> None:
    areas, shares = geometric_levels(count, 0.01, ratio, 2.0)
    a = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 4000) * 0.01, areas])
    weights = DiscreteLevels(areas, shares, smooth).weight(np.arange(1.0, count + 1), a[:, None])
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ridge", [0.5, 1 / np.log(2), 3.0])
def test_t_21_the_continuous_supports_integrate_to_one(ridge: float) -> None:
    """By the midpoint rule: its error at the kinks is below step² times the jump of slope."""
    family = RidgeLevels(np.log(3), ridge, 1.0)
    for a in (0.0, 1e-3, 0.1, 1.0, 7.0, 100.0, 1e6):
        top = float(family.middle(a)) + 1
        nu = (np.arange(200_000) + 0.5) / 200_000 * top
        assert family.weight(nu, a).mean() * top == pytest.approx(1, abs=1e-4)


def test_t_22_the_sphere_around_a_lobe_is_the_smallest() -> None:
    """Lobe r = R √cos θ about the normal: inside for every θ, touched, and any other height on the axis needs a larger radius."""
    theta = np.linspace(0, np.pi / 2, 20_001)
    lobe = np.sqrt(np.cos(theta))[:, None] * np.stack([np.sin(theta), np.cos(theta)], axis=1)

    def radius(height: float) -> float:
        return float(np.linalg.norm(lobe - [0, height], axis=1).max())

    assert radius(DROP_HEIGHT) == pytest.approx(DROP_WIDTH, abs=1e-6)
    assert min(radius(h) for h in np.linspace(0, 1, 401)) >= DROP_WIDTH - 1e-6
    rng = np.random.default_rng(2)
    x = rng.uniform([-1, -0.2, -1], [1, 1.2, 1], (100_000, 3))
    inside = coordinate(x, np.zeros(3), np.array([0, 1.0, 0])) < 1
    assert inside.sum() > 5000
    assert (np.linalg.norm(x[inside] - [0, DROP_HEIGHT, 0], axis=1) <= DROP_WIDTH).all()


def lights_around(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lights all over the box and as many within a quarter of its radius of the camera, before it, around it and behind it."""
    world, rng = toy_box().world(), generator(8, "lights")
    near = world.camera.pose[:3, 3] + rng.normal(size=(count // 2, 3)) * 0.25
    places = np.concatenate([rng.uniform(-1, 1, (count - count // 2, 3)) / RADIUS, near])
    return places.astype(np.float32), uniform_sphere(rng.random((count, 2))).astype(np.float32)


@pytest.mark.gl
def test_t_23_tiles_hold_their_spheres() -> None:
    """2164 spheres anywhere around the camera: each pixel whose surface lies in a sphere is drawn once for it, all others never."""
    from renderers.gl.splat import splat as splat_gl

    world = toy_box().world()
    g = cast_gbuffer(world, (48, 36))
    centres = lights_around(2164)[0].astype(np.float64)
    radii = np.geomspace(0.005, 1.5, len(centres))
    snippet = """
        struct Item { vec4 sphere; };
        Item item_at(int index) { return Item(item_texel(index, 0)); }
        bool misses(Node node, int index) { return false; }
        vec4 contribution(Receiver receiver, Item item) {
            return vec4(distance(receiver.position, item.sphere.xyz) <= item.sphere.w ? 1.0 : 0.0);
        }
    """
    drawn = splat_gl(g, world, centres, radii, np.zeros((len(centres), 1)), snippet)[0][..., 0]
    distance = np.linalg.norm(g.position[:, :, None] - centres, axis=-1) - radii
    # float32 can't tell which side a pixel lies on within 1e-6 of the border
    sure, unsure = (distance < -1e-6).sum(axis=-1), (np.abs(distance) <= 1e-6).sum(axis=-1)
    assert sure.sum() > 100_000
    assert (drawn >= sure).all()
    assert (drawn <= sure + unsure).all()


@pytest.mark.gl
@pytest.mark.parametrize("reach", [0.02, 0.1, 0.5])
def test_t_24_bounds_change_nothing_but_the_work(reach: float) -> None:
    """Spheres around the supports against endless ones, and the CPU's tiles against every pair: one image."""
    from renderers.gl.cuts import splat_cuts

    world = toy_box().world()
    g = cast_gbuffer(world, (48, 36))
    places, normals = lights_around(300)
    family = DiscreteLevels(*geometric_levels(3, reach**2, 2.0, 2.0))
    marks = family.draw(generator(9, "levels").random(len(places)))
    white = np.ones_like(places) / family.density(marks)[:, None]
    rows = np.concatenate([places.T, normals.T, white.T, family.parameters(marks)]).astype(np.float32)
    centres, radii = spheres_of(rows)
    bounded, _, touched = splat_cuts(g, world, rows, (centres, radii), family.kernel, 1e-3)
    everywhere, _, all_touched = splat_cuts(g, world, rows, (0 * centres, 0 * radii + 4), family.kernel, 1e-3)
    assert touched == all_touched > 0
    np.testing.assert_array_equal(bounded, everywhere)
    counters = Counter[str]()
    tiled = splat(g, world, rows, family, 1e-3, None, counters)
    one_by_one = sum(
        splat(g, world, np.ascontiguousarray(rows[:, [i]]), family, 1e-3).astype(np.float64) for i in range(len(places))
    )
    np.testing.assert_allclose(tiled, one_by_one, rtol=1e-5, atol=1e-6 * float(tiled.max()))
    assert counters["light_evaluations"] < 0.5 * int(g.covered.sum()) * len(places)


def test_t_25_no_bias_against_quadrature() -> None:
    """Mean over the image: within 4 standard errors of FRAMES random shifts, and within 0.5 % for the 64 of a Sobol' sequence.

    One frame varies by 14 % as a whole, so FRAMES of them by 0.64 %. The truth has 2¹⁷ Sobol' points.
    """
    images, truth = frames()
    means = images.mean(axis=1)
    error = means.std(ddof=1) / np.sqrt(FRAMES)
    assert error < 0.01 * truth.mean()
    assert abs(means.mean() - truth.mean()) < 4 * error
    assert progressive().mean() == pytest.approx(truth.mean(), rel=0.005)


def interleaved_ratios(side: int, count: int) -> Iterator[float]:
    """Mean of the light with side² sub-images over that without, before the filter, of as many frames."""
    world, settings = toy_box().world(), resolved()
    g, family, eps_b = cast_gbuffer(world, SMALL), family_of(toy_box(), settings), EPS_B * toy_box().world().scale ** 2
    parts = list(sub_images(g, side))
    for seed in range(count):
        points = resample(world, settings.eta * world.scale**2, seed)
        drawn = draw(world, family, settings.model_copy(update={"interleave": side}), seed, Counter(), points)
        total = splat(g, world, drawn.rows, family, eps_b).mean(dtype=np.float64)
        strong = drawn.rows.copy()
        strong[6:9] *= side * side
        images = [
            splat(part, world, np.ascontiguousarray(strong[:, drawn.place == i]), family, eps_b)
            for i, (_, part) in enumerate(parts)
        ]
        yield float(np.mean([image.mean(dtype=np.float64) for image in images]) / total)


@pytest.mark.parametrize("side", [2, 3])
def test_t_26_interleaving_keeps_the_mean(side: int) -> None:
    """Each point's own number says which sub-image it lights; mean 1, not 1 / side². 100 frames."""
    ratio = np.array(list(interleaved_ratios(side, 100)))
    error = ratio.std(ddof=1) / 10
    assert error < 0.01
    assert abs(ratio.mean() - 1) < 4 * error


def test_t_30_progressive_error_falls_with_the_root_of_the_frames() -> None:
    """Random shifts of one set of vertex numbers: slope of the relative RMS from 1 to 64 frames, over 8 blocks of 64."""
    images, truth = frames()
    errors = []
    for block in (1, 4, 16, 64):
        means = images.reshape(-1, block, len(truth)).mean(axis=1)
        errors.append(np.sqrt(np.mean((means / truth - 1) ** 2)))
    slope = np.polyfit(np.log([1, 4, 16, 64]), np.log(errors), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.15)
    assert errors[-1] < 0.1


def test_t_30_sobol_shifts_beat_random_ones() -> None:
    """The mean of the first 64 of `progressive_shift` has under half the error of 64 random ones (0.0012 and 0.0057 printed)."""
    images, truth = frames()
    random = np.sqrt(np.mean((images.reshape(-1, 64, len(truth)).mean(axis=1) / truth - 1) ** 2))
    assert np.sqrt(np.mean((progressive() / truth - 1) ** 2)) < random / 2


def test_t_31_counters_multiply_up() -> None:
    """Lit VPLs × pixels per VPL = VPLs per pixel × pixels: exactly, the middle one counted light by light."""
    world, settings = toy_box().world(), resolved(400)
    g, family = cast_gbuffer(world, SMALL), family_of(toy_box(), settings)
    counters = Counter[str]()
    drawn = draw(world, family, settings, 1, counters, resample(world, settings.eta * world.scale**2, 1))
    assert counters["vpls_lit"] == drawn.rows.shape[1] == sum(n for name, n in counters.items() if name.startswith("vpls_level_"))
    single = Counter[str]()
    for i in range(counters["vpls_lit"]):
        splat(g, world, np.ascontiguousarray(drawn.rows[:, [i]]), family, EPS_B * world.scale**2, None, single)
    frame = METHOD.render(toy_box(), linked(400), size=SMALL, seed=1)
    assert frame.counters["vpls_lit"] == counters["vpls_lit"]
    assert frame.counters["pixels_touched"] == single["pixels_touched"]


@cache
def reference() -> tuple[np.ndarray, float]:
    """Image of the box without visibility between bounces, by 2¹⁷ Sobol' points, and its exposure."""
    frame = IR.render(
        toy_box(), IrSettings(vpls=TRUTH, sampler="low-discrepancy", eps_b=EPS_B, light_samples=1), size=SIZE, seed=11
    )
    image = mixture(frame)
    return image, 1 / float(np.percentile(image, 98))


def mixture(frame: Any) -> np.ndarray:
    """0.25 × direct + indirect, so that the bounce is what one sees."""
    return np.asarray(0.25 * frame.layers["direct"] + frame.layers["indirect"])


@cache
def compared(passes: int, interleave: int) -> tuple[float, float, int]:
    """RMSE (0 … 255), SSIM, and lit pairs, of 6000 points."""
    frame = METHOD.render(toy_box(), linked(POINTS, passes=passes, interleave=interleave), size=SIZE, seed=2)
    pair = Pair(mixture(frame), reference()[0], reference()[1])
    similarity = ssim(pair)
    assert similarity is not None
    return rmse(pair), similarity, frame.counters["pixels_touched"]


def test_t_32_the_progressive_image_converges_to_the_brute_force_one() -> None:
    """64 passes: RMSE < 3 and SSIM > 0.998 (1.96 and 0.9992 printed)."""
    error, similarity, _ = compared(64, 1)
    assert error < 3
    assert similarity > 0.998


def test_t_33_one_frame_looks_like_the_limit() -> None:
    """SSIM ≥ 0.97 (0.981 printed)."""
    assert compared(1, 1)[1] >= 0.97


def test_t_34_sixteen_sub_images_cost_a_sixteenth() -> None:
    """Lit pairs fall 16 × ± 10 %; SSIM ≥ 0.93 after the filter (0.949 printed)."""
    _, similarity, touched = compared(1, 4)
    assert compared(1, 1)[2] / touched == pytest.approx(16, rel=0.1)
    assert similarity >= 0.93
