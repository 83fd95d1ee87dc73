"""Paired changes over seeds, and how many of them may be called real when many are looked at.

A change pairs the same seeds before and after, so what a seed does to both drops out. Under 16 seeds the paired Student t test,
from 16 a seeded symmetric bootstrap-t, as for intervals. One seed allows no test. Equal changes in every seed need none.

Many changes are tested in one comparison. Holm (1979) keeps the probability of even one false alarm under the level, whatever
the dependence between the tests: metrics of one image depend strongly on one another, and one false alarm already stops a
release. Benjamini and Hochberg's procedure would only bound the share of false ones among the alarms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from reports.statistics import BOOTSTRAP_FROM, LEVEL

# A p-value of a bootstrap is at least 1 / (RESAMPLES + 1): small enough for a thousand tests at a family-wise level of 1 %.
RESAMPLES = 99_999
BATCH = 1 << 21  # drawn values held at a time

Kind = Literal["none", "exact", "student-t", "bootstrap"]


@dataclass(frozen=True)
class Paired:
    """Mean of after − before over n seeds, its 95 % interval and the two-sided p-value against no change.

    kind `none` (one seed): no interval, no p-value. `exact` (every seed changed by the same): low = high = change, p 0 or 1.
    """

    change: float
    low: float | None
    high: float | None
    p: float | None
    kind: Kind
    n: int


def paired(before: Sequence[float], after: Sequence[float]) -> Paired:
    """Change of paired values. Raises ValueError where the lengths differ or nothing is given."""
    if len(before) != len(after) or not before:
        raise ValueError(f"pairs need equal, positive numbers of values, got {len(before)} and {len(after)}")
    d = np.asarray(after, np.float64) - np.asarray(before, np.float64)
    mean, n = float(d.mean()), len(d)
    if n == 1:
        return Paired(mean, None, None, None, "none", 1)
    if (d == d[0]).all():
        return Paired(float(d[0]), float(d[0]), float(d[0]), float(d[0] == 0), "exact", n)
    error = float(d.std(ddof=1)) / np.sqrt(n)
    if n < BOOTSTRAP_FROM:
        from scipy import stats

        quantile = float(stats.t.ppf(0.5 + LEVEL / 2, n - 1))
        p = float(2 * stats.t.sf(abs(mean) / error, n - 1))
        return Paired(mean, mean - quantile * error, mean + quantile * error, p, "student-t", n)
    t = _bootstrap_t(d)
    half = float(np.quantile(t[np.isfinite(t)], LEVEL)) * error
    p = (1 + int(np.count_nonzero(t >= abs(mean) / error))) / (len(t) + 1)
    return Paired(mean, mean - half, mean + half, p, "bootstrap", n)


def _bootstrap_t(d: NDArray[np.float64]) -> NDArray[np.float64]:
    """|m* − m| / (s* / √n) of seeded resamples; infinite where a resample has no spread, which can only raise p."""
    rng, n = np.random.default_rng(0), len(d)
    found = []
    left = RESAMPLES
    while left > 0:
        draws = d[rng.integers(0, n, (min(left, max(BATCH // n, 1)), n))]
        spread = draws.std(axis=1, ddof=1)
        off = np.abs(draws.mean(axis=1) - d.mean())
        found.append(np.divide(off * np.sqrt(n), spread, out=np.full(len(off), np.inf), where=spread > 0))
        left -= len(draws)
    return np.concatenate(found)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values in the given order: those at or under a level are significant at that family-wise level."""
    p = np.asarray(p_values, np.float64)
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)) if len(p) else p
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return [float(v) for v in adjusted]
