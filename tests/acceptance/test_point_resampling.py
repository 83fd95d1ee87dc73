"""Dynamic point resampling: the draw of the points, check by check; T numbers are those of the specification.

The estimator of the light that the points send is checked in `test_point_resampling_light.py`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from soups import apart, ellipsoid, equal_triangles, mixed, positions_of, soup

from renderers.scene.world import World
from renderers.transport.cuts import DiscreteLevels, geometric_levels
from renderers.transport.resampling.numbers import keys, mix
from renderers.transport.resampling.pattern import count, level, pattern, printed_level, shares
from renderers.transport.resampling.points import Points, resample

DRAWS = 10_000
LEVELS = DiscreteLevels(*geometric_levels(3, 1.0, 2.0, 2.0))
F = np.array([0.9, -0.7, 1.4])


def linear(points: np.ndarray) -> np.ndarray:
    """A test function whose square is a polynomial of second degree: the middles of edges integrate both exactly."""
    return np.asarray(1.5 + points @ F)


def moments(world: World) -> tuple[np.ndarray, np.ndarray]:
    """∫ f and ∫ f² of each triangle, (T,)."""
    p = world.positions[world.triangles].astype(np.float64)
    middles = (p + np.roll(p, -1, axis=1)) / 2
    values = linear(middles)
    return world.areas * values.mean(axis=1), world.areas * (values**2).mean(axis=1)


@cache
def draws(expected: int) -> tuple[World, np.ndarray, np.ndarray]:
    """Numbers of points and sums η f of DRAWS seeds on a closed mesh of 1984 triangles, none larger than a point's area."""
    world = ellipsoid(32, 32)
    eta = float(world.areas.sum()) / expected
    assert world.areas.max() < eta
    numbers, sums = np.empty(DRAWS), np.empty(DRAWS)
    for seed in range(DRAWS):
        points = resample(world, eta, seed)
        numbers[seed], sums[seed] = len(points), eta * linear(positions_of(world, points)).sum()
    return world, numbers, sums


def standard_error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


@cache
def many_places() -> np.ndarray:
    """(u, v) of two million points on triangles that are all kept."""
    world = equal_triangles(500_000)
    points = [resample(world, 1.0, seed) for seed in range(4)]
    return np.concatenate([np.stack([p.u, p.v], axis=1) for p in points]).astype(np.float64)


def test_t_1_places_are_uniform() -> None:
    """χ² over 256 cells of equal area; two million points."""
    uv = many_places()
    assert len(uv) == 2_000_000
    cell = np.floor(uv * 16).astype(int)
    upper = ((uv * 16 - cell).sum(axis=1) > 1).astype(int)
    # the cells of row j: 16 - j lower and 15 - j upper triangles
    counts = np.bincount(cell[:, 0] * 34 + cell[:, 1] * 2 + upper, minlength=16 * 34)
    counts = np.array([counts[i * 34 + j * 2 + k] for i in range(16) for j in range(16 - i) for k in range(2) if i + j + k < 16])
    assert len(counts) == 256
    assert counts.sum() == len(uv)
    expected = len(uv) / 256
    assert 0.75 < ((counts - expected) ** 2 / expected).sum() / 255 < 1.25


def test_t_2_moments_of_the_places() -> None:
    u, v = many_places().T
    assert u.mean() == pytest.approx(1 / 3, abs=5e-4)
    assert v.mean() == pytest.approx(1 / 3, abs=5e-4)
    assert u.var() == pytest.approx(1 / 18, abs=5e-4)
    assert v.var() == pytest.approx(1 / 18, abs=5e-4)
    assert np.cov(u, v)[0, 1] == pytest.approx(-1 / 36, abs=5e-4)


@pytest.mark.parametrize("expected", [250, 700])
def test_t_3_mean_number_is_the_area_over_eta(expected: int) -> None:
    _, numbers, _ = draws(expected)
    assert abs(numbers.mean() - expected) < 4 * standard_error(numbers)


@pytest.mark.parametrize("expected", [250, 700])
def test_t_4_variance_of_the_number(expected: int) -> None:
    """Σ u (1 - u). 5 % are 3.5 standard errors of a variance of 10,000 draws."""
    world, numbers, _ = draws(expected)
    chance = world.areas * expected / world.areas.sum()
    assert numbers.var(ddof=1) == pytest.approx((chance * (1 - chance)).sum(), rel=0.05)


def test_t_5_triangles_are_kept_pairwise_independently() -> None:
    """All 51,040 correlations of a closed mesh of 320 triangles within 5 standard errors of 0."""
    world = ellipsoid(16, 11)
    eta = float(world.areas.max()) * 1.01
    kept = np.zeros((DRAWS, len(world.triangles)))
    for seed in range(DRAWS):
        kept[seed, resample(world, eta, seed).triangle] = 1
    correlation = np.corrcoef(kept.T)[np.triu_indices(len(world.triangles), 1)]
    assert len(correlation) == 320 * 319 // 2
    assert np.abs(correlation).max() < 5 / np.sqrt(DRAWS)


@pytest.mark.parametrize("expected", [250, 700])
def test_t_6_sums_are_unbiased(expected: int) -> None:
    world, _, sums = draws(expected)
    assert abs(sums.mean() - moments(world)[0].sum()) < 4 * standard_error(sums)


@pytest.mark.parametrize("expected", [250, 700])
def test_t_7_variance_identity(expected: int) -> None:
    """Var = η ∫ f² - Σ (∫_t f)², which is T4's for f = 1/η."""
    world, _, sums = draws(expected)
    first, second = moments(world)
    eta = world.areas.sum() / expected
    assert sums.var(ddof=1) == pytest.approx(eta * second.sum() - (first**2).sum(), rel=0.05)


def level_draws(world: World, eta: float, **rules: object) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of points at each of three levels, and the estimate of ∫ (f_1 + f_2 + f_3), f_k = k f; of 4000 seeds."""
    numbers, sums = np.empty((4000, 3)), np.empty(4000)
    for seed in range(len(sums)):
        points = resample(world, eta, seed, **rules)  # type: ignore[arg-type]
        # what lies above the last threshold belongs to no level; `draw` would count it as the last
        chosen = np.where(level_number(points) < 1, LEVELS.draw(level_number(points)), 0).astype(int)
        numbers[seed] = np.bincount(chosen, minlength=4)[1:]
        weight = eta * points.weight / np.concatenate([[np.inf], LEVELS.shares])[chosen]
        sums[seed] = (weight * chosen * linear(positions_of(world, points))).sum()
    return numbers, sums


def level_number(points: Points) -> np.ndarray:
    """number / chance, without the guard that keeps it under 1."""
    return np.asarray((points.numbers[:, 0] + 0.5) / 2.0**32 / points.chance)


def test_t_8_t_9_one_draw_gives_all_levels() -> None:
    """Counts |S| / η_k of each level, and no bias of a sum of three functions, each sampled at its own level alone."""
    world = ellipsoid(32, 21)
    eta = float(world.areas.max()) * 1.2
    numbers, sums = level_draws(world, eta)
    expected = world.areas.sum() / eta * LEVELS.shares
    for k in range(3):
        assert abs(numbers[:, k].mean() - expected[k]) < 4 * standard_error(numbers[:, k])
    assert abs(sums.mean() - 6 * moments(world)[0].sum()) < 4 * standard_error(sums)


def test_t_10_a_triangle_too_large_loses_the_last_level_unless_carried() -> None:
    """Negative control: nothing is cut up, the largest triangle has 1.1 η. As printed the last level lacks points; carried none."""
    world = ellipsoid(32, 21)
    eta = float(world.areas.max()) / 1.1
    large = world.areas > eta
    assert large.any()
    numbers, sums = level_draws(world, eta, patches=0, carry=False)
    expected = world.areas.sum() / eta * LEVELS.shares
    lost = ((world.areas - eta)[large] / eta).sum()
    assert expected[2] - numbers[:, 2].mean() > 4 * standard_error(numbers[:, 2])
    assert numbers[:, 2].mean() == pytest.approx(expected[2] - lost, abs=4 * standard_error(numbers[:, 2]))
    truth = 6 * moments(world)[0].sum()
    assert truth - sums.mean() > 4 * standard_error(sums)
    _, carried = level_draws(world, eta, patches=0)
    assert abs(carried.mean() - truth) < 4 * standard_error(carried)


def test_t_11_the_pattern_has_t_of_n_parts() -> None:
    for n in range(1, 65):
        assert len(pattern(n)) == count(n) == (3 * n * n // 2 if n % 2 == 0 else (3 * n * n - 1) // 2)
    assert [count(n) for n in range(1, 9)] == [1, 6, 13, 24, 37, 54, 73, 96]
    assert count(64) == 6144


def test_t_12_parts_are_equal_but_the_middle_one_of_odd_levels() -> None:
    """Exact in the lattice: 2/(3n²), and 1/n² once where n is odd; the sum is 1."""
    for n in range(1, 65):
        part = np.sort(shares(n))
        expected = np.full(count(n), 2 / (3 * n * n))
        if n % 2:
            expected[-1] = 1 / (n * n)
        np.testing.assert_allclose(part, expected, rtol=1e-12)
        assert part.sum() == pytest.approx(1, abs=1e-12)


def test_t_13_the_printed_level_is_the_smallest_with_enough_parts() -> None:
    n = 1
    for parts in range(1, 20_001):
        while count(n) < parts:
            n += 1
        assert printed_level(parts) == n
        assert level(np.float32(parts), False) == min(n, 64)


def counted(ratio: float, seeds: int = 60, **rules: object) -> float:
    """Number of points over the expected one, on 400 triangles of `ratio` points each."""
    world = equal_triangles(400)
    return float(np.mean([len(resample(world, 1 / ratio, seed, **rules)) for seed in range(seeds)])) / (400 * ratio)  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [12.01, 13, 24, 37])
def test_t_14_even_levels_lose_nothing(ratio: float) -> None:
    """0.5 % are 4 standard errors: Σ u (1 - u) ≤ 400 · 24 / 4 for 12.01, over 60 seeds 0.13 % of 4804."""
    assert counted(ratio) == pytest.approx(1, abs=0.005)
    n = level(np.float32(ratio), True)
    assert n % 2 == 0
    assert count(n) >= ratio > count(n - 2)


@pytest.mark.parametrize(("ratio", "kept"), [(13, 0.966), (12.01, 0.972), (37, 0.987)])
def test_t_15_the_printed_rule_loses_points_at_odd_levels(ratio: float, kept: float) -> None:
    """The middle part has 1.5 shares, of which 0.5 are lost at ratio 13: 3.4 %. The carry rule gives them back as weight."""
    assert counted(ratio, rule="printed", carry=False) == pytest.approx(kept, abs=0.005)
    world = equal_triangles(400)
    weights = [resample(world, 1 / ratio, seed, rule="printed").weight.sum(dtype=np.float64) for seed in range(60)]
    assert np.mean(weights) / (400 * ratio) == pytest.approx(1, abs=0.005)


def drawn_on_gl(world: World, area: float, seed: int = 0, shift: tuple[int, int] = (0, 0), **rules: object) -> Points:
    """The GL twin's points, sorted."""
    from renderers.gl.resample import resample as resample_gl

    return Points(*resample_gl(world, area, keys(seed), shift, **rules)).sorted()  # type: ignore[arg-type]


@pytest.mark.gl
def test_t_16_t_17_number_and_levels_on_the_gpu() -> None:
    """Both passes together on a fine ball in a coarse box: 20,000 points, over 40 seeds."""
    world = mixed()
    eta = float(world.areas.sum()) / 20_000
    found = [drawn_on_gl(world, eta, seed) for seed in range(40)]
    numbers = np.array([len(points) for points in found], float)
    assert abs(numbers.mean() - 20_000) < 4 * standard_error(numbers)
    levels = np.array([np.bincount(LEVELS.draw(p.level_number).astype(int), minlength=4)[1:] for p in found], float)
    for k in range(3):
        assert abs(levels[:, k].mean() - 20_000 * LEVELS.shares[k]) < 4 * standard_error(levels[:, k])


@pytest.mark.gl
def test_t_18_the_indirect_draw_is_the_direct_one() -> None:
    world = mixed()
    eta = float(world.areas.sum()) / 20_000
    indirect, direct = (drawn_on_gl(world, eta, 5, indirect=i) for i in (True, False))
    same(indirect, direct)


def same(a: Points, b: Points) -> None:
    """The same points to a rounding of float32; llvmpipe rounds as numpy does, so there the same bits."""
    np.testing.assert_array_equal(a.triangle, b.triangle)
    np.testing.assert_array_equal(a.numbers, b.numbers)
    for name in ("u", "v", "chance", "weight"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-6, atol=1e-7)


@pytest.mark.gl
@pytest.mark.parametrize("expected", [50, 3000, 300_000])
@pytest.mark.parametrize("rules", [{}, {"rule": "printed"}, {"carry": False}, {"patches": 3}])
def test_gl_and_cpu_draw_the_same_points(expected: int, rules: dict[str, object]) -> None:
    from renderers.gl.device import device_string

    if "patches" in rules and "llvmpipe" not in device_string():
        pytest.skip("who gets too little room is a race on a GPU; software renderers take triangles in their order")
    world = mixed()
    eta = float(world.areas.sum()) / expected
    on_gl = {name: value for name, value in rules.items() if name != "rule"} | {"even": rules.get("rule") != "printed"}
    same(resample(world, eta, 9, (77, 1 << 31), **rules).sorted(), drawn_on_gl(world, eta, 9, (77, 1 << 31), **on_gl))  # type: ignore[arg-type]


def test_t_19_lattice_points_have_numbers_of_their_own() -> None:
    """A texture of 256² texels gives each its own up to n = 64 (one of 128² doesn't); the hash that stands here always does."""
    for n in range(1, 65):
        points = np.unique(pattern(n).reshape(-1, 2), axis=0)
        texels = np.unique(np.minimum(points * 256 // (3 * n), 255), axis=0)
        assert len(texels) == len(points)
        codes = (points[:, 0].astype(np.uint64) << np.uint64(16)) | points[:, 1].astype(np.uint64)
        assert len(np.unique(mix.py_func(codes))) == len(points)
    coarse = np.unique(pattern(64).reshape(-1, 2), axis=0) * 128 // 192
    assert len(np.unique(coarse, axis=0)) < len(coarse)


def turned(positions: np.ndarray, angle: float, offset: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(positions.astype(np.float64) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + offset, np.float32)


def test_t_27_rigid_motion_keeps_the_points() -> None:
    """Rotated and 5 units away, in float32: at most 1e-4 of the triangles change their minds."""
    world = mixed()
    eta = float(world.areas[:-12].sum()) / 1000  # the ball's triangles are small, the walls' large
    still = resample(world, eta, 1)
    for angle in (0.3, 1.2, 2.9):
        moved = resample(soup(turned(world.positions, angle, np.array([5.0, -3.0, 1.0])), world.triangles), eta, 1)
        changed = np.setxor1d(still.numbers[:, 0], moved.numbers[:, 0])
        assert len(changed) <= 1e-4 * len(world.triangles)


def test_t_28_local_deformation_changes_only_what_is_deformed() -> None:
    world = ellipsoid(256, 128)
    eta = float(world.areas.sum()) / 4000
    inside = world.positions[:, 1] > 0.3
    grown = world.positions.copy()
    grown[inside] *= np.float32(1.01)
    other = soup(grown, world.triangles)
    before, after = resample(world, eta, 3), resample(other, eta, 3)
    touched = inside[world.triangles].any(axis=1)
    changed = np.setxor1d(before.triangle, after.triangle)
    assert touched[changed].all()
    expected = np.abs(other.areas - world.areas).sum() / eta
    assert abs(len(changed) - expected) < 4 * np.sqrt(expected)
    # points of untouched triangles stay where they were, to the bit
    same_before, same_after = (np.flatnonzero(~touched[p.triangle]) for p in (before, after))
    np.testing.assert_array_equal(before.u[same_before], after.u[same_after])


def test_t_29_growing_triangles_move_to_neighbouring_denser_levels() -> None:
    """Monotone in the area; by up to 5 % no level is skipped. Dropped comes after the last level."""
    world = ellipsoid(128, 64)
    eta = float(world.areas.max()) * 1.3
    levels = []
    for factor in (0.95, 1.0, 1.01, 1.05):
        points = resample(soup(world.positions * np.float32(np.sqrt(factor)), world.triangles), eta, 2)
        chosen = np.full(len(world.triangles), 4)
        chosen[points.triangle] = LEVELS.draw(points.level_number)
        levels.append(chosen)
    steps = -np.diff(np.array(levels), axis=0)
    assert (steps >= 0).all()
    assert set(np.unique(steps)) == {0, 1}


def test_still_geometry_has_one_set_of_points() -> None:
    """A camera that moves changes nothing: the set is a function of geometry, η* and seed."""
    from renderers import load_scene

    scene = load_scene("colonnade", triangles=20_000)
    first, second = scene.world(0), scene.world(7)
    same(resample(first, 1e-3, 4), resample(second, 1e-3, 4))


def test_points_do_not_depend_on_the_order_of_triangles() -> None:
    world = mixed(32)
    eta = float(world.areas.sum()) / 5000
    order = np.random.default_rng(1).permutation(len(world.triangles))
    there, here = resample(soup(world.positions, world.triangles[order]), eta, 6), resample(world, eta, 6)
    np.testing.assert_array_equal(np.sort(there.numbers, axis=0), np.sort(here.numbers, axis=0))


def test_refused_areas() -> None:
    for area in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="must be positive"):
            resample(apart([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]), area)
