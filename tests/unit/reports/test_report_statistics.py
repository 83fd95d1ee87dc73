"""Intervals, differences, error budgets, Pareto fronts and equal-time ratios, each against a known answer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from reports.statistics import (
    Truth,
    budget,
    difference,
    equal_time,
    interval,
    mean_budget,
    pareto,
    reference_decides,
    truth,
)


def test_one_value_has_no_interval() -> None:
    found = interval([3.0])
    assert (found.kind, found.low, found.high, found.n) == ("none", 3.0, 3.0, 1)
    with pytest.raises(ValueError, match="no values"):
        interval([])


def test_equal_values_are_exact() -> None:
    assert interval([0.1] * 5).kind == "exact"
    assert interval([0.1] * 20).half == 0
    assert interval([0.1] * 3).mean == 0.1


def test_students_t_under_16() -> None:
    found = interval([1.0, 2.0, 3.0])
    assert found.kind == "student-t"
    assert found.half == pytest.approx(4.3026527 / np.sqrt(3))
    assert interval(list(np.arange(15.0))).kind == "student-t"


def test_bootstrap_from_16_is_seeded() -> None:
    values = list(np.random.default_rng(3).normal(size=16))
    assert interval(values).kind == "bootstrap"
    assert interval(values) == interval(values)


@pytest.mark.parametrize("n", [4, 16])
def test_intervals_cover_the_mean_95_times_in_100(n: int) -> None:
    samples = np.random.default_rng(0).normal(5.0, 1.0, (300, n))
    covered = np.mean([(found := interval(list(x))).low <= 5.0 <= found.high for x in samples])
    # 300 trials at 95 % have a standard deviation of 1.26 %; three of them are 3.8 %.
    assert covered == pytest.approx(0.95, abs=0.038)


def test_difference_is_welchs() -> None:
    rng = np.random.default_rng(1)
    a, b = list(rng.normal(3, 1, 6)), list(rng.normal(1, 0.2, 9))
    found = difference(a, b)
    expected = stats.ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    assert (found.low, found.high) == (pytest.approx(expected.low), pytest.approx(expected.high))
    assert found.decided == (expected.low > 0 or expected.high < 0)


def test_difference_without_spread_or_with_one_seed() -> None:
    assert difference([2.0, 2.0], [1.0, 1.0]).decided
    assert not difference([1.0, 1.0], [1.0, 1.0]).decided
    one = difference([2.0], [1.0, 1.1])
    assert one.low is None
    assert not one.decided
    with pytest.raises(ValueError, match="no values"):
        difference([], [1.0])


def test_budget_finds_the_parts_it_was_made_of() -> None:
    rng = np.random.default_rng(2)
    matched = rng.uniform(20, 200, (64, 64, 3))
    full = matched + rng.normal(0, 5, matched.shape)
    seeds = 8
    images = [matched + 2 + rng.normal(0, 3, matched.shape) for _ in range(seeds)]
    found = budget(images, matched, full)
    assert found.noise is not None
    # Over N = 12288 values: noise is a variance on 7 N degrees of freedom (relative deviation sqrt(2/7N) = 0.5 %); bias has
    # 2·2·3/sqrt(8 N) = 0.04 beside a deviation of the noise's share; alone is a variance on N (relative 1.3 %); four deviations
    # each.
    assert found.noise == pytest.approx(9, rel=0.02)
    assert found.bias == pytest.approx(4, abs=0.2)
    assert found.model_alone == pytest.approx(25, rel=0.052)
    # The bias is constant and the model's part averages out, so the interaction 2⟨(x̄ − m)(m − f)⟩ deviates by 2·2·5/sqrt(N) = 0.18.
    assert found.model == pytest.approx(found.model_alone, abs=0.8)
    assert found.noise + found.bias + found.floor + found.model == pytest.approx(found.total, rel=1e-12)
    assert found.total == pytest.approx(np.mean([np.mean((x - full) ** 2) for x in images]), rel=1e-12)


def test_budget_algebra_is_exact_with_few_seeds() -> None:
    rng = np.random.default_rng(4)
    images, matched, full = [rng.random((3, 4, 3)) for _ in range(3)], rng.random((3, 4, 3)), rng.random((3, 4, 3))
    found = budget(images, matched, full, floor=0.01)
    centre = np.mean(images, axis=0)
    noise = sum(np.mean((x - centre) ** 2) for x in images) / 2
    interaction = 2 * np.mean((centre - matched) * (matched - full))
    assert found.noise == pytest.approx(noise)
    assert found.bias == pytest.approx(np.mean((centre - matched) ** 2) - noise / 3 - 0.01)
    assert found.model == pytest.approx(found.model_alone + interaction)


def test_reference_noise_does_not_count_as_bias() -> None:
    rng = np.random.default_rng(5)
    exact = rng.uniform(20, 200, (64, 64, 3))
    noisy = exact + rng.normal(0, 2, exact.shape)
    found = budget([exact, exact], noisy, noisy, floor=4.0)
    assert found.noise == 0
    # A variance of 4 on 12288 values deviates by 4·sqrt(2/12288) = 0.05; four deviations.
    assert found.bias == pytest.approx(0, abs=0.2)
    assert found.model == 0


def test_budget_of_one_seed_does_not_invent_noise() -> None:
    image, zero = np.ones((2, 2, 3)), np.zeros((2, 2, 3))
    found = budget([image], zero, zero)
    assert found.noise is None
    assert (found.bias, found.model, found.total) == (1, 0, 1)
    with pytest.raises(ValueError, match="at least one"):
        budget([], zero, zero)


def test_mean_budget_still_adds_up() -> None:
    rng = np.random.default_rng(6)
    parts = [
        budget([rng.random((3, 3, 3)) for _ in range(2)], rng.random((3, 3, 3)), rng.random((3, 3, 3)), 0.01) for _ in range(4)
    ]
    mean = mean_budget(parts)
    assert mean.noise is not None
    assert mean.bias == pytest.approx(np.mean([p.bias for p in parts]))
    assert mean.noise + mean.bias + mean.floor + mean.model == pytest.approx(mean.total)
    with pytest.raises(ValueError, match="no budgets"):
        mean_budget([])


point = st.tuples(st.integers(1, 6).map(float), st.integers(0, 6).map(float))


@given(st.lists(point, max_size=12))
def test_pareto_front_holds_exactly_what_nothing_beats(points: list[tuple[float, float]]) -> None:
    front = pareto(points)
    beaten = {p for p in points if any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)}
    assert {points[i] for i in front} == set(points) - beaten
    assert [points[i] for i in front] == sorted({points[i] for i in front})


def test_equal_time_uses_measured_points_only() -> None:
    traced = [(1.0, 8.0), (4.0, 4.0), (16.0, 2.0)]
    found = equal_time((5.0, 1.0), traced)
    assert found.error_ratio == 4
    assert found.speedup is None
    assert equal_time((0.5, 3.0), traced).error_ratio is None
    assert equal_time((0.5, 3.0), traced).speedup == 32
    assert equal_time((5.0, 0.0), traced).error_ratio is None


def test_reference_decides_beyond_its_own_noise() -> None:
    rng = np.random.default_rng(7)
    shape = (16, 16, 3)
    exact = np.full(shape, 0.4)
    quiet, noisy = (truth(exact, np.full(shape, s**2), 1.0) for s in (1e-5, 0.3))
    near, far = quiet.display + 1.0, quiet.display + rng.normal(0, 2, shape)
    assert reference_decides(near, far, quiet, quiet)
    assert not reference_decides(near, far, noisy, noisy)
    assert not reference_decides(near, near, quiet, quiet)


def test_two_references_add_their_noise() -> None:
    rng = np.random.default_rng(9)
    shape = (16, 16, 3)
    exact = np.full(shape, 100.0)
    near, far = exact + 1.0, exact + rng.normal(0, 2, shape)
    quiet = Truth(exact, np.full(shape, 0.01))
    noisy = Truth(exact + 10.0 * rng.standard_normal(shape[:2])[..., None], np.full(shape, 10.0))
    other = Truth(exact.copy(), np.full(shape, 0.01))
    assert reference_decides(near, far, quiet, other)
    assert not reference_decides(near, far, quiet, noisy)


def test_reference_noise_swaps_the_order_as_often_as_said() -> None:
    rng = np.random.default_rng(8)
    shape = (16, 16, 3)
    exact, spread = np.full(shape, 100.0), np.full(shape, 3.0)
    a, b = exact + rng.normal(0, 2, shape), exact + rng.normal(0, 2, shape)
    gaps = []
    for _ in range(400):
        r = exact + 3.0 * rng.standard_normal(shape[:2])[..., None]
        gaps.append(np.mean((a - r) ** 2) - np.mean((b - r) ** 2))
    # The bound takes a pixel's channels as moving together with |a − b|; signs that differ make the true deviation smaller, never
    # larger.
    deviation = 2 * np.sqrt(np.sum(np.mean(np.abs(a - b) * spread, axis=2) ** 2)) / 256
    assert np.std(gaps) < 1.1 * deviation
    same = Truth(exact, spread)
    expected = abs(np.mean((a - exact) ** 2) - np.mean((b - exact) ** 2)) > 1.96 * deviation
    assert reference_decides(a, b, same, same) == expected
