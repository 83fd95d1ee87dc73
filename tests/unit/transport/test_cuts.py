"""Levels and support functions of forward light cuts: the mathematical acceptance checks of the method, by number."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from renderers.transport.cuts import (
    DROP_HEIGHT,
    DROP_WIDTH,
    UNBOUNDED,
    DiscreteLevels,
    Family,
    LinearLevels,
    RidgeLevels,
    coordinate,
    enclosing_spheres,
    geometric_levels,
)
from renderers.transport.roulette import RouletteLevels
from renderers.transport.sampling import generator

COUNTS, RATIOS = (1, 2, 3, 5, 8), (1.2, 2.0, 3.0, 5.0)
COORDINATES = np.concatenate([[0.0], np.geomspace(1e-8, 1e8, 3001)])


def discrete(count: int, area: float = 0.25, ratio: float = 2.0, shares: float = 3.0, smooth: bool = True) -> DiscreteLevels:
    return DiscreteLevels(*geometric_levels(count, area, ratio, shares), smooth)


def total(family: DiscreteLevels, a: np.ndarray) -> np.ndarray:
    return np.sum([family.weight(k, a) for k in range(1, len(family.areas) + 1)], axis=0)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_ac_1_hats_are_a_partition_of_unity(count: int, ratio: float) -> None:
    np.testing.assert_allclose(total(discrete(count, ratio=ratio), COORDINATES), 1, rtol=0, atol=1e-12)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_ac_2_steps_are_a_partition_of_unity(count: int, ratio: float) -> None:
    family = discrete(count, ratio=ratio, smooth=False)
    middles = (family.areas[1:] + family.areas[:-1]) / 2
    np.testing.assert_array_equal(total(family, np.concatenate([COORDINATES, middles])), 1)


def test_ac_3_the_printed_shells_are_no_partition() -> None:
    """(4.11) as printed, shells [a_{k-1}, a_k): nothing covers α ≥ a_K."""
    areas = np.concatenate([[0.0], discrete(3).areas])
    covered = np.sum([(areas[k - 1] <= COORDINATES) & (areas[k] > COORDINATES) for k in (1, 2, 3)], axis=0)
    np.testing.assert_array_equal(covered, np.where(areas[-1] > COORDINATES, 1, 0))
    assert (covered == 0).any()


def test_ac_4_hats_are_continuous_and_overlap_by_two() -> None:
    family = discrete(5)
    a = np.linspace(0, 10, 1_000_001)
    weights = np.stack([family.weight(k, a) for k in range(1, 6)])
    assert np.abs(np.diff(weights)).max() / (a[1] - a[0]) == pytest.approx(1 / (0.25 * (2 - 1)), rel=1e-6)
    assert (weights > 0).sum(axis=0).max() == 2


def printed_linear(nu: float, a: np.ndarray, hats: DiscreteLevels) -> np.ndarray:
    """(4.45) case by case: ν below 1, between two levels, at or above K."""
    count = len(hats.areas)
    k = int(np.floor(nu))
    if nu < 1:
        return nu * hats.weight(1, a)
    if k >= count:
        return (count + 1 - nu) * hats.weight(count, a)
    return (k + 1 - nu) * hats.weight(k, a) + (nu - k) * hats.weight(k + 1, a)


@pytest.mark.parametrize("count", [1, 3, 5])
def test_ac_5_sum_of_hats_is_the_linear_family(count: int) -> None:
    hats = discrete(count)
    family = LinearLevels(hats.areas, np.log(3))
    a = np.geomspace(1e-3, 1e3, 200)
    nodes = np.arange(0, count + 1 + 1e-9, 0.25)
    for nu in nodes[:-1]:
        np.testing.assert_allclose(family.weight(nu, a), printed_linear(nu, a, hats), rtol=0, atol=1e-12)
    # The trapezium rule is exact for a function that is linear between its nodes.
    values = np.stack([family.weight(nu, a) for nu in nodes])
    np.testing.assert_allclose(np.trapezoid(values, nodes, axis=0), 1, rtol=0, atol=1e-12)
    short = nodes <= count
    far = np.trapezoid(values[short], nodes[short], axis=0)[-1]
    assert far == pytest.approx(0.5, abs=1e-12)  # over the printed range ]0, K[


@pytest.mark.parametrize("ridge", [0.5, 0.91, 1.44, 3.0])
def test_ac_6_the_ridge_has_unit_integral(ridge: float) -> None:
    family = RidgeLevels(np.log(3), ridge, 1.0)
    for a in [0.0, *np.geomspace(1e-6, 1e6, 121)]:
        mid = float(family.middle(a))
        nodes = [max(0.0, mid - 1), mid, mid + 1]
        x, w = np.polynomial.legendre.leggauss(4)
        area = sum(
            float((family.weight(low + (high - low) * (x + 1) / 2, a) * w).sum()) * (high - low) / 2
            for low, high in pairwise(nodes)
        )
        assert area == pytest.approx(1, abs=1e-12)


def test_ac_7_support_of_one_level_of_the_ridge() -> None:
    family = RidgeLevels(np.log(3), 1 / np.log(2), 1.0)
    low, high = family.bounds(1.5)
    assert (float(low), float(high)) == pytest.approx((0.41421356, 4.65685425), abs=1e-8)
    a = np.linspace(0, 8, 800_001)
    active = a[family.weight(1.5, a) > 0]
    assert (active[0], active[-1]) == pytest.approx((float(low), float(high)), abs=2e-5)


def test_ac_8_frequencies_of_the_levels() -> None:
    family = discrete(3)
    numbers = generator(1, "levels").random(2_000_000)
    counts = np.bincount(family.draw(numbers).astype(int), minlength=4)[1:]
    assert stats.chisquare(counts, family.shares * len(numbers)).pvalue > 0.001
    np.testing.assert_allclose(family.shares, np.array([9, 3, 1]) / 13, rtol=1e-14)


def test_ac_8_the_draw_is_the_smallest_level_that_satisfies() -> None:
    family = discrete(3)
    edges = np.cumsum(family.shares)
    numbers = np.array([0.0, np.nextafter(edges[0], 0), edges[0], np.nextafter(edges[1], 0), edges[1], np.nextafter(1, 0)])
    np.testing.assert_array_equal(family.draw(numbers), [1, 1, 2, 2, 3, 3])


@pytest.mark.parametrize(
    ("family", "cdf"),
    [
        (RidgeLevels(np.log(3), 1.0, 1.0), stats.expon(scale=1 / np.log(3))),
        (LinearLevels(np.array([0.25, 0.5, 1.0]), np.log(3)), stats.truncexpon(4 * np.log(3), scale=1 / np.log(3))),
    ],
)
def test_ac_9_continuous_levels_follow_their_law(family: Family, cdf: object) -> None:
    marks = family.draw(generator(2, "levels").random(1_000_000))
    assert stats.kstest(marks, cdf.cdf).pvalue > 0.001  # type: ignore[attr-defined]
    assert marks.mean() == pytest.approx(cdf.mean(), abs=4 * cdf.std() / 1000)  # type: ignore[attr-defined]


@pytest.mark.parametrize("smooth", [True, False])
def test_ac_10_expected_discrete_weight_is_one(smooth: bool) -> None:
    family = discrete(5, smooth=smooth)
    levels = np.arange(1.0, 6)
    mean = sum(family.density(k) * family.weight(k, COORDINATES) / family.density(k) for k in levels)
    np.testing.assert_allclose(mean, 1, rtol=0, atol=1e-12)


@pytest.mark.parametrize("a", [0.05, 0.7, 5.0, 40.0])
@pytest.mark.parametrize(
    "family", [RidgeLevels(np.log(3), 1 / np.log(2), 1.0), LinearLevels(np.array([0.25, 0.5, 1.0]), np.log(3))]
)
def test_ac_11_expected_continuous_weight_is_one(family: Family, a: float) -> None:
    marks = family.draw(generator(3, "levels").random(1_000_000))
    weights = family.weight(marks, a) / family.density(marks)
    assert abs(weights.mean() - 1) < 4 * weights.std() / 1000


FAMILIES = {
    "ir": DiscreteLevels(np.array([0.1]), np.array([1.0])),
    "c-1": DiscreteLevels(np.array([0.1, 0.2, 0.4]), np.array([9, 3, 1]) / 13, smooth=False),
    "c0": DiscreteLevels(np.array([0.1, 0.2, 0.4]), np.array([9, 3, 1]) / 13),
    "linear": LinearLevels(np.array([0.1, 0.2, 0.4]), np.log(3)),
    "ridge": RidgeLevels(np.log(3), 1 / np.log(2), 0.1),
    "ridge, stable": RidgeLevels(np.log(3), 1 / np.log(3), 0.1),
    "roulette": RouletteLevels(0.1),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_ac_12_the_estimator_gives_the_form_factor_of_a_rectangle(name: str) -> None:
    """Receiver at the origin, facing [0, 2]×[0, 1.5] at height 0.8 that faces down with radiance 1; ε_Ω = 0.1, no clamp."""
    family, rng = FAMILIES[name], generator(4, "rectangle " + name)
    x, y = 2 / 0.8, 1.5 / 0.8
    p, q = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    exact = 0.5 * (x / p * np.arctan(y / p) + y / q * np.arctan(x / q))
    assert exact == pytest.approx(0.66458, abs=1e-5)
    points = np.concatenate([rng.random((1_000_000, 2)) * [2, 1.5], np.full((1_000_000, 1), 0.8)], axis=1)
    r2 = np.einsum("ij,ij->i", points, points)
    marks = family.draw(rng.random(len(points)))
    alpha = coordinate(np.zeros(3), points, np.array([0, 0, -1.0]), threshold=0.1)
    terms = family.weight(marks, alpha) / family.density(marks) * 0.8**2 / r2**2 * 3
    assert abs(terms.mean() - exact) < 4 * terms.std() / 1000
    # The second moment of one term is that of instant radiosity times M(α), on average over the surface.
    moment = (family.second_moment(alpha) * (0.8**2 / r2**2 * 3) ** 2).mean()
    assert (terms**2).mean() == pytest.approx(moment, rel=0.05)


def test_ac_13_second_moments() -> None:
    values = discrete(3).second_moment(np.geomspace(1e-3, 1e3, 20001))
    assert (values.min(), values.max()) == (pytest.approx(1.0833, abs=1e-4), pytest.approx(13, rel=1e-12))
    ridge = RidgeLevels(np.log(3), 1.4427, 1.0)
    assert float(ridge.second_moment(10.0)) == pytest.approx(28.82758, abs=5e-6)
    assert float(ridge.second_moment(0.0)) == pytest.approx(1.63607, abs=5e-6)


@pytest.mark.parametrize("a", [0.0, 1e-9, 0.05, 0.3, 1.0, 10.0, 300.0])
@pytest.mark.parametrize("family", [RidgeLevels(np.log(3), 1 / np.log(2), 1.0), RidgeLevels(0.7, 0.5, 2.0)])
def test_ac_13_second_moments_by_quadrature(family: RidgeLevels, a: float) -> None:
    mid = float(family.middle(a))
    parts = [
        integrate.quad(lambda nu: float(family.weight(nu, a)) ** 2 / float(family.density(nu)), low, high, epsabs=0, epsrel=1e-12)[
            0
        ]
        for low, high in ((max(0, mid - 1), mid), (mid, mid + 1))
        if high > low
    ]
    assert float(family.second_moment(a)) == pytest.approx(sum(parts), rel=1e-9)


def largest_share(family: DiscreteLevels) -> np.ndarray:
    """max over a of s_k(a) / (μ_k a), k = 2 … K; a hat's peak and its flanks are covered by a fine grid through the knots."""
    a = np.unique(np.concatenate([np.geomspace(1e-2, 1e3, 20001), family.areas]))
    return np.array([(family.weight(k, a) / (family.density(k) * a)).max() for k in range(2, len(family.areas) + 1)])


def test_ac_18_largest_contribution_of_one_light() -> None:
    linked = discrete(5, ratio=3.0)
    np.testing.assert_allclose(largest_share(linked), 1 / (linked.shares * linked.areas)[1:], rtol=1e-9)
    np.testing.assert_allclose(largest_share(linked), 1.49383 * 4, rtol=1e-5)
    other = discrete(5, area=0.25, ratio=2.0)
    np.testing.assert_allclose(largest_share(other), 1 / (other.shares * other.areas)[1:], rtol=1e-9)
    assert (np.diff(largest_share(other)) > 0.1).all()


def test_ac_19_geometry_of_the_drop() -> None:
    cosine = np.linspace(0, 1, 2_000_001)
    r = np.sqrt(cosine)
    width, height = r * np.sqrt(1 - cosine**2), r * cosine
    assert width.max() == pytest.approx(DROP_WIDTH, abs=1e-5)
    assert height[width.argmax()] == pytest.approx(DROP_HEIGHT, abs=1e-5)
    assert height.max() == pytest.approx(1, abs=1e-5)
    assert np.hypot(width, height - DROP_HEIGHT).max() == pytest.approx(DROP_WIDTH, abs=1e-5)
    assert np.trapezoid(2 * np.pi * r**3 / 3, cosine) == pytest.approx(4 * np.pi / 15, abs=1e-5)
    surface = np.stack([width, 0 * width, height], axis=1)[1:-1]
    np.testing.assert_allclose(coordinate(surface, np.zeros(3), np.array([0, 0, 1.0])), 1, rtol=1e-9)


@pytest.mark.parametrize(
    ("a", "area", "tolerance"), [(0.1, 0.93737, 0.025), (0.4, 4.70163, 0.01), (1.6, 14.18699, 0.01), (6.4, 38.08859, 0.01)]
)
def test_ac_20_area_of_a_plane_inside_the_drop(a: float, area: float, tolerance: float) -> None:
    """π [(a d/ε)^(2/3) - d²]⁺ at distance d = 0.7 for ε = 0.1, and by points on the plane, each a light
    that faces the receiver at the origin."""
    d, eps, half = 0.7, 0.1, 5.0
    exact = np.pi * ((a * d / eps) ** (2 / 3) - d * d)
    assert exact == pytest.approx(area, abs=1e-5)
    points = np.concatenate([generator(5, "plane").uniform(-half, half, (1_000_000, 2)), np.full((1_000_000, 1), d)], axis=1)
    inside = coordinate(np.zeros(3), points, np.array([0, 0, -1.0]), eps) <= a
    assert inside.mean() * (2 * half) ** 2 == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize(
    ("depth", "shares"),
    [(0.01, (0.8320, 0.0622, 0.1058)), (0.05, (0.5088, 0.1818, 0.3094)), (0.1, (0.2202, 0.2885, 0.4912)), (0.4, (0, 0, 1))],
)
def test_ac_21_energy_of_each_level_on_an_infinite_plane(depth: float, shares: tuple[float, ...]) -> None:
    """e_k = ∫_0^1 s_k(ε d² v^(-3/2)) dv for a = 0.1, 0.2, 0.4; depth is ε d²."""
    family = FAMILIES["c0"]
    assert isinstance(family, DiscreteLevels)
    knots = np.clip((depth / family.areas) ** (2 / 3), 0, 1)
    edges = np.unique(np.concatenate([[0.0], knots, [1.0]]))
    energy = [
        sum(
            integrate.quad(lambda v, k=k: float(family.weight(k, depth * v**-1.5)), low, high, epsabs=1e-10)[0]
            for low, high in pairwise(edges)
        )
        for k in (1, 2, 3)
    ]
    assert sum(energy) == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(energy, shares, atol=5e-5)


def test_ac_24_the_sphere_holds_the_drop_in_3000_cases() -> None:
    rng = generator(6, "drops")
    lights, normals = rng.normal(size=(3000, 3)), rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outer = rng.uniform(0.01, 9, 3000)
    centres, radii = enclosing_spheres(lights, normals, outer)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", directions, normals)
    directions *= np.where(cosine < 0, -1, 1)[:, None]
    border = lights + (np.sqrt(outer * np.abs(cosine)))[:, None] * directions
    assert (np.linalg.norm(border - centres, axis=1) <= radii * (1 + 1e-9)).all()
    assert np.linalg.norm(border - centres, axis=1).max() > 0.99 * radii[np.linalg.norm(border - centres, axis=1).argmax()]


def test_ac_27_the_printed_tables_multiply_up() -> None:
    """Laurent 2018, tables 4.1 and 4.2: lit VPLs × share of pixels per VPL = VPLs per pixel.

    Within one unit of the share's last digit: 424.20 / 29336 is 1.446 %, printed as 1.44 %."""
    rows = [
        (29336, 6.60, 1936.94), (29336, 1.51, 443.55), (7404, 1.54, 114.23), (954, 1.36, 13.02),
        (29336, 1.44, 424.20), (7404, 1.5, 111.02), (954, 1.3, 12.51),
    ]  # fmt: skip
    for lit, share, each in rows:
        digit = 0.1 if share in (1.5, 1.3) else 0.01
        assert abs(lit * share / 100 - each) <= lit * digit / 100


def test_ac_31_hard_shells_are_the_levels_a_chain_descends_to() -> None:
    """From level K down while Ω_{a_k} > ε_Ω, that is while α < a_k: level k keeps [a_k, a_{k+1}), level 1 also [0, a_1)."""
    areas = discrete(4).areas
    for a in np.linspace(0, 4, 1001):
        k = len(areas)
        while k > 1 and a < areas[k - 1]:
            k -= 1
        assert k == max(1, int(np.searchsorted(areas, a, side="right")))
        printed = int(np.searchsorted(areas, a, side="right")) + 1
        assert (printed == k) == (a < areas[0])


@given(
    st.sampled_from(sorted(FAMILIES)),
    st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=20),
    st.lists(st.floats(0, 1e6), min_size=1, max_size=20),
)
def test_h_18_bounds_hold_the_support_and_weights_stay_finite(name: str, numbers: list[float], coordinates: list[float]) -> None:
    family = FAMILIES[name]
    marks, a = family.draw(numbers)[:, None], np.array(coordinates)
    low, high = family.bounds(marks)
    weights = family.weight(marks, a) / family.density(marks)
    assert np.isfinite(weights).all()
    assert (weights >= 0).all()
    # Supports of levels are 1 at most, 2 where two of them share a light; roulette's u = 2^-ν survives by a weight up to 3/2 / u.
    largest = 1.5 * np.exp2(marks) if name == "roulette" else 2.0
    # A weight of the ridge may round to 1e-16 beyond its own end.
    assert (weights * family.density(marks) <= np.where((a >= low) & (a <= high), largest * (1 + 1e-12), 1e-12)).all()
    assert np.isfinite(family.parameters(marks[:, 0])).all()
    assert (high <= UNBOUNDED).all()


def test_levels_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="ratios > 1"):
        geometric_levels(3, 1.0, 1.0, 2.0)


U_NODES, U_WEIGHTS = (0.5 * (x + 1) if k == 0 else 0.5 * x for k, x in enumerate(np.polynomial.legendre.leggauss(200)))


def over_numbers(family: RouletteLevels, a: float, power: int) -> float:
    """∫_0^1 W(u, a)^power du, Gauss-Legendre on the pieces between the flank's ends."""
    ends = np.unique(np.clip([0.0, 0.5 * float(family.area) / a, 1.5 * float(family.area) / a, 1.0], 0, 1))
    total = 0.0
    for low, high in pairwise(ends):
        numbers = low + (high - low) * U_NODES
        total += (high - low) * float((family.weight(-np.log2(numbers), a) ** power * U_WEIGHTS).sum())
    return total


@pytest.mark.parametrize("a", [1e-6, 0.1, 0.149, 0.15, 0.2, 0.31, 0.45, 0.46, 3.0, 1e4])
def test_roulette_has_unit_mean_and_its_second_moment(a: float) -> None:
    family = RouletteLevels(0.3)
    assert over_numbers(family, a, 1) == pytest.approx(1, abs=1e-12)
    assert over_numbers(family, a, 2) == pytest.approx(float(family.second_moment(a)), rel=1e-12)


def test_roulette_is_near_the_least_variance_times_cost() -> None:
    """E[W²] P(W > 0) ≥ E[W]² = 1 for every law; roulette's flank costs 5/4, hats of ratio 2 cost 3/2 in the mean over a shell."""
    a = np.linspace(1.0, 2.0, 2001)
    roulette, hats = RouletteLevels(0.3), discrete(8, area=1 / 16, ratio=2.0, shares=2.0)
    acting = np.minimum(1, 1.5 * 0.3 / a)
    np.testing.assert_allclose(roulette.second_moment(a) * acting, 1.25, rtol=1e-12)
    levels = np.arange(1.0, 9.0)
    shares = ((hats.weight(levels, a[:, None]) > 0) * hats.shares).sum(axis=1)
    assert np.mean(hats.second_moment(a) * shares) == pytest.approx(1.5, abs=0.001)


def test_roulette_acts_within_its_bounds_and_no_contribution_exceeds_the_cap() -> None:
    family = RouletteLevels(0.3)
    marks = family.draw(generator(4, "levels").random(50))
    a = np.geomspace(1e-4, 1e6, 20001)
    for mark, end in zip(marks, family.bounds(marks)[1], strict=True):
        weight = family.weight(mark, a)
        assert (weight[a >= end * (1 + 1e-9)] == 0).all()
        assert (weight[a < end * (1 - 1e-3)] > 0).all()
        # cos θ / r² = 1/α: beyond the flank no light brings more than one that covers the finest level's solid angle
        assert (weight / a)[a >= 0.15].max() <= 2 / 0.3 * (1 + 1e-12)
        assert (weight / a)[a >= 0.45].max(initial=0) <= 1 / 0.3 * (1 + 1e-12)


def test_roulette_follows_brightness() -> None:
    family = RouletteLevels(0.3).among(np.array([[1.0, 1, 1], [2, 2, 2], [0, 0, 9], [1e-30, 0, 0]]))
    np.testing.assert_allclose(family.area, 0.3 * np.array([3, 6, 9, 18e-6 / 4]) / 4.5, rtol=1e-12)
    assert RouletteLevels(0.3).among(np.zeros((0, 3))).area == 0.3
    assert discrete(3).among(np.ones((2, 3))).kernel == discrete(3).kernel


def test_ac_30_the_printed_geometric_factor_is_zero_where_the_right_one_is_not() -> None:
    """(2.17) prints the direction from y to x in both cosines: then no two surfaces that see one another exchange light."""
    rng = generator(30, "pairs")
    x, y, nx, ny = (rng.normal(size=(200_000, 3)) for _ in range(4))
    direction = x - y
    right = np.maximum(0, (direction * ny).sum(axis=1)) * np.maximum(0, (-direction * nx).sum(axis=1))
    printed = np.maximum(0, (direction * ny).sum(axis=1)) * np.maximum(0, (direction * nx).sum(axis=1))
    assert (right > 0).mean() == pytest.approx(0.25, abs=0.005)
    assert not printed[right > 0].any()
