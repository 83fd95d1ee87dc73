"""Uncertainty over seeds, differences between methods, the error budget, the Pareto front, and equal-time comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from renderers.images import display_values

Array = NDArray[np.float64]
LEVEL = 0.95
BOOTSTRAP_FROM = 16
RESAMPLES = 4000


@dataclass(frozen=True)
class Interval:
    """Mean of n values and its 95 % interval.

    kind: how it was made; for `none` (one value) and `exact` (all equal) low = high = mean.
    """

    mean: float
    low: float
    high: float
    n: int
    kind: Literal["none", "exact", "student-t", "bootstrap"]

    @property
    def half(self) -> float:
        """Half the width."""
        return (self.high - self.low) / 2


def interval(values: Sequence[float]) -> Interval:
    """95 % interval of the mean: none for one value, Student's t under 16, a seeded bootstrap-t from 16.

    Bootstrap-t (Efron and Tibshirani, ch. 12): quantiles of (m* − m)/s* over resamples, so that it keeps its coverage at n = 16,
    where plain percentiles fall short. Raises ValueError for no values.
    """
    if not values:
        raise ValueError("no values")
    x = np.asarray(values, np.float64)
    mean, n = float(x.mean()), len(x)
    if n == 1:
        return Interval(mean, mean, mean, 1, "none")
    if (x == x[0]).all():
        return Interval(float(x[0]), float(x[0]), float(x[0]), n, "exact")
    error = float(x.std(ddof=1)) / np.sqrt(n)
    if n < BOOTSTRAP_FROM:
        from scipy import stats

        half = float(stats.t.ppf(0.5 + LEVEL / 2, n - 1)) * error
        return Interval(mean, mean - half, mean + half, n, "student-t")
    draws = x[np.random.default_rng(0).integers(0, n, (RESAMPLES, n))]
    spread = draws.std(axis=1, ddof=1)
    t = (draws.mean(axis=1) - mean)[spread > 0] / (spread[spread > 0] / np.sqrt(n))
    low, high = np.quantile(t, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return Interval(mean, mean - float(high) * error, mean - float(low) * error, n, "bootstrap")


@dataclass(frozen=True)
class Difference:
    """Mean of a minus mean of b with its 95 % interval; low and high are None where one seed allows none."""

    value: float
    low: float | None
    high: float | None

    @property
    def decided(self) -> bool:
        """Whether the difference exceeds its uncertainty."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)


def difference(a: Sequence[float], b: Sequence[float]) -> Difference:
    """Welch's interval of mean(a) − mean(b), for values over seeds. Raises ValueError when one is empty."""
    if not a or not b:
        raise ValueError("no values")
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    value = float(x.mean() - y.mean())
    if min(len(x), len(y)) < 2:
        return Difference(value, None, None)
    vx, vy = (0.0 if (v == v[0]).all() else float(v.var(ddof=1)) / len(v) for v in (x, y))
    if vx + vy == 0:
        return Difference(value, value, value)
    from scipy import stats

    degrees = (vx + vy) ** 2 / (vx**2 / (len(x) - 1) + vy**2 / (len(y) - 1))
    half = float(stats.t.ppf(0.5 + LEVEL / 2, degrees)) * float(np.sqrt(vx + vy))
    return Difference(value, value - half, value + half)


@dataclass(frozen=True)
class Budget:
    """Mean squared error against the full reference, in display values squared (0–255)², as parts that add up to `total` exactly.

    Images x₁…x_S over seeds, their mean x̄, matched reference m, full reference f, ⟨·⟩ the mean over pixels and channels:

    noise  ⟨Σ(x_s − x̄)²⟩ / (S − 1), the estimator's variance; None for one seed
    bias   ⟨(x̄ − m)²⟩ − noise/S − floor, what the method gets wrong about its own transport; an unbiased estimate, so it may come
           out slightly below 0; with one seed it holds the noise too
    floor  the matched reference's own noise, squared
    model  mean_s ⟨(x_s − f)²⟩ − mean_s ⟨(x_s − m)²⟩, the price of the transport model

    Since mean_s ⟨(x_s − m)²⟩ = (S − 1)/S · noise + ⟨(x̄ − m)²⟩, noise + bias + floor is the mean squared error against m, and adding
    model gives that against f. model = model_alone + 2⟨(x̄ − m)(m − f)⟩ with model_alone = ⟨(m − f)²⟩: it falls below model_alone,
    even below 0, where the method's bias makes up for missing paths.
    """

    noise: float | None
    bias: float
    floor: float
    model: float
    model_alone: float
    total: float
    seeds: int


def budget(images: Sequence[Array], matched: Array, full: Array, floor: float = 0.0) -> Budget:
    """Split the error of display images (H, W, 3), one per seed, against the matched and the full reference; see `Budget`.

    floor: mean squared noise of the matched reference in the same units. Raises ValueError without images.
    """
    if not images:
        raise ValueError("a budget needs at least one image")
    seeds = len(images)
    against_matched = float(np.mean([np.mean((x - matched) ** 2) for x in images]))
    against_full = float(np.mean([np.mean((x - full) ** 2) for x in images]))
    noise = None
    if seeds > 1:
        same = all(np.array_equal(x, images[0]) for x in images[1:])
        centre = np.mean(images, axis=0)
        noise = 0.0 if same else float(sum(np.mean((x - centre) ** 2) for x in images) / (seeds - 1))
    bias = against_matched - (noise or 0.0) - floor
    return Budget(noise, bias, floor, against_full - against_matched, float(np.mean((matched - full) ** 2)), against_full, seeds)


def mean_budget(budgets: Sequence[Budget]) -> Budget:
    """Mean over frames; the parts still add up. Raises ValueError for none."""
    if not budgets:
        raise ValueError("no budgets")
    noises = [b.noise for b in budgets if b.noise is not None]
    noise = float(np.mean(noises)) if len(noises) == len(budgets) else None
    parts = np.mean([[b.floor, b.model, b.model_alone, b.total] for b in budgets], axis=0)
    floor, model, alone, total = (float(p) for p in parts)
    return Budget(noise, total - model - floor - (noise or 0.0), floor, model, alone, total, min(b.seeds for b in budgets))


@dataclass(frozen=True, eq=False)
class Truth:
    """A reference in display values, (H, W, 3), with the standard deviation of its mean there, (H, W, 3)."""

    display: Array
    spread: Array


def truth(reference: NDArray[np.floating], variance: NDArray[np.floating], exposure: float) -> Truth:
    """Carry a linear reference and its variance (H, W, 3) into display values: half the change over ± one standard deviation."""
    sigma = np.sqrt(variance.astype(np.float64))
    low = np.maximum(reference - sigma, 0.0)
    spread = (display_values(reference + sigma, exposure) - display_values(low, exposure)) / 2
    return Truth(display_values(reference, exposure), spread)


def reference_decides(a: Array, b: Array, truth_a: Truth, truth_b: Truth) -> bool:
    """Whether the references' noise can't have swapped the order of two methods by squared error.

    a, b: display values (H, W, 3), means over seeds, each with its own truth; the same object for both means the same reference
    image. Noise e of a reference moves ⟨(a − r)²⟩ by −2⟨(a − r) e⟩ + ⟨e²⟩. With one reference for both, the difference moves by
    −2⟨(a − b) e⟩ only; with two, each error moves on its own, and the expected ⟨e²⟩ are taken off first. N pixels whose channels
    move together (the worst case) give the standard deviation 2/N · sqrt(Σ (mean_c |weight|_c σ_c)²). Weights measured against the
    noisy reference hold σ² of its noise, hence 4 Σσ⁴/N² in the variance, more than the 2 Σσ⁴/N² by which ⟨e²⟩ itself varies. The
    order is decided beyond 1.96 standard deviations.
    """
    gap = float(np.mean((a - truth_a.display) ** 2) - np.mean((b - truth_b.display) ** 2))
    if truth_a is truth_b:
        moved = [np.mean(np.abs(a - b) * truth_a.spread, axis=2)]
    else:
        gap -= float(np.mean(truth_a.spread**2) - np.mean(truth_b.spread**2))
        moved = [np.mean(np.abs(x - t.display) * t.spread, axis=2) for x, t in ((a, truth_a), (b, truth_b))]
    deviation = np.sqrt(sum(float(np.sum(m**2)) / m.size**2 for m in moved))
    return abs(gap) > 1.96 * 2.0 * float(deviation)


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (seconds, error) that no other beats in both, by rising seconds; of equal points the first."""
    front: list[int] = []
    best = float("inf")
    for index in sorted(range(len(points)), key=lambda i: (*points[i], i)):
        if points[index][1] < best:
            front.append(index)
            best = points[index][1]
    return front


@dataclass(frozen=True)
class EqualTime:
    """A method against path tracing, both as measured. Ratios above 1 favour the method; None where path tracing has no such point.

    error_ratio: error of the best path-traced image that took no longer, over the method's. speedup: seconds of the fastest
    path-traced image that is no worse, over the method's.
    """

    error_ratio: float | None
    speedup: float | None


def equal_time(point: tuple[float, float], path_traced: Sequence[tuple[float, float]]) -> EqualTime:
    """Compare (seconds, error) with measured path-traced points; nothing between them is invented."""
    seconds, error = point
    within = [e for s, e in path_traced if s <= seconds]
    as_good = [s for s, e in path_traced if e <= error]
    return EqualTime(
        min(within) / error if within and error > 0 else None,
        min(as_good) / seconds if as_good and seconds > 0 else None,
    )
