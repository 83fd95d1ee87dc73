"""Paired changes and the control of false alarms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from reports.paired import holm, paired
from reports.regression import LEVEL


def test_one_seed_allows_no_statistics() -> None:
    found = paired([3.0], [4.0])
    assert (found.change, found.low, found.high, found.p, found.kind) == (1.0, None, None, None, "none")


def test_equal_changes_in_every_seed_are_exact() -> None:
    assert paired([1.0, 2.0], [1.5, 2.5]).p == 0.0
    same = paired([1.0, 2.0], [1.0, 2.0])
    assert (same.change, same.low, same.high, same.p, same.kind) == (0.0, 0.0, 0.0, 1.0, "exact")


def test_few_seeds_use_the_paired_t_test() -> None:
    before, after = [1.0, 2.0, 3.5, 5.0], [1.2, 2.1, 3.9, 5.1]
    found = paired(before, after)
    expected = stats.ttest_rel(after, before)
    assert found.kind == "student-t"
    assert found.p == pytest.approx(expected.pvalue)
    assert (found.low, found.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))


def test_pairing_sees_what_unpaired_values_hide() -> None:
    rng = np.random.default_rng(3)
    before = rng.normal(10, 1, 6)
    after = before + 0.1 + rng.normal(0, 0.005, 6)
    assert (paired(list(before), list(after)).p or 1) < 1e-5
    assert stats.ttest_ind(before, after).pvalue > 0.5


def test_many_seeds_use_a_seeded_bootstrap_that_agrees_with_t_on_normal_data() -> None:
    rng = np.random.default_rng(0)
    before = rng.normal(0, 1, 40)
    after = before + rng.normal(0.15, 1, 40)
    found, again = paired(list(before), list(after)), paired(list(before), list(after))
    assert found == again
    assert found.kind == "bootstrap"
    # On normal data the bootstrap-t tends to Student's t; at n = 40 its quantiles differ by a few per cent.
    expected = stats.ttest_rel(after, before)
    assert found.p == pytest.approx(expected.pvalue, rel=0.35)
    interval = expected.confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((interval.low, interval.high), abs=0.1 * (interval.high - interval.low))


def test_unequal_numbers_are_refused() -> None:
    with pytest.raises(ValueError, match="equal, positive"):
        paired([1.0], [1.0, 2.0])
    with pytest.raises(ValueError, match="equal, positive"):
        paired([], [])


def test_holm_against_a_worked_example() -> None:
    # Holm 1979: sorted p times 4, 3, 2, 1, never falling: .02, .03, .03, .04 (order of input kept).
    assert holm([0.04, 0.005, 0.01, 0.01]) == pytest.approx([0.04, 0.02, 0.03, 0.03])
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30))
@settings(deadline=None)
def test_holm_lies_between_plain_and_bonferroni(p: list[float]) -> None:
    for plain, adjusted in zip(p, holm(p), strict=True):
        assert plain <= adjusted <= min(1.0, plain * len(p)) + 1e-12


@pytest.mark.parametrize("seeds", [4, 6, 12])
def test_false_alarms_over_a_whole_night_stay_under_the_level(seeds: int) -> None:
    nights, tests = 1000, 60
    rng = np.random.default_rng(seeds)
    # Metrics of one row depend on one another: three tests share one draw, as RMSE, SSIM and bias of one image do.
    shared = np.repeat(rng.normal(size=(nights, tests // 3, seeds)), 3, axis=1)
    d = shared + 0.3 * rng.normal(size=(nights, tests, seeds))
    t = d.mean(2) / (d.std(2, ddof=1) / np.sqrt(seeds))
    p = 2 * stats.t.sf(np.abs(t), seeds - 1)
    alarms = sum(min(holm(list(night))) <= LEVEL for night in p)
    # Holm's bound is LEVEL per night; more than the 99.9 % quantile of that many nights would contradict it.
    assert alarms <= stats.binom.ppf(0.999, nights, LEVEL)
