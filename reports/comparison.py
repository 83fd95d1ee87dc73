"""Compare images with the registry's metrics: one image, a sequence, and what the reference's own noise would measure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reports.metrics import Pair
from reports.registry import METRICS

Image = NDArray[np.floating]
Row = dict[str, float | None]

TOO_NOISY = 0.20
TOO_NOISY_FOR_CLAIMS = 0.05


def compare(
    test: Image,
    reference_image: Image,
    exposure: float = 1.0,
    luminance_variance: Image | None = None,
    n: int | None = None,
    *,
    nightly: bool = False,
) -> Row:
    """Every metric of one image by id, None where a metric is not defined.

    Both images are linear (H, W, 3); luminance_variance (H, W) is that of the reference's mean over n replicates, and widens
    `over_2pct_surely` and `over_2pct_possibly` around `over_2pct`. `nightly` adds the slow metrics. Raises ValueError as `Pair`
    does.
    """
    return measure(Pair(test, reference_image, exposure, luminance_variance, n), nightly=nightly)


def measure(pair: Pair, *, nightly: bool = False) -> Row:
    """Every single-image metric of a Pair by id."""
    return {m.id: m.function(pair) for m in METRICS.values() if m.function is not None and (nightly or not m.nightly)}


def measure_change(before: Pair, after: Pair) -> Row:
    """Every metric of sequences by id, of two consecutive frames of equal size."""
    return {m.id: m.change(before, after) for m in METRICS.values() if m.change is not None}


def noise_floor(reference_image: Image, variance: Image, exposure: float = 1.0) -> Row:
    """Metrics that the reference's noise alone produces: the reference plus one seeded draw of its noise, against itself.

    variance (H, W, 3) is that of the mean. The draw moves a pixel's three channels together (they share their light paths), which
    is the largest change of luminance that these variances allow: the floor is not too low.
    """
    return measure(noisy(reference_image, variance, exposure))


@dataclass(frozen=True, eq=False)
class Noise:
    """A reference's mean and the variance of it, both (H, W, 3), and a sample of its error where one is known."""

    mean: Image
    variance: Image
    sample: Image | None = None


def flicker_floor(before: Noise, after: Noise, exposure: float = 1.0) -> Row:
    """Metrics of sequences that the noise of two references alone produces.

    References take their random numbers in every frame anew from the start, so where little moves their noise stays and makes no
    flicker: samples of their errors move together in the same way. Without samples, two independent draws of `noise_floor` give
    what it is at most. By the triangle inequality the flicker against noise-free references lies within ± this of the measured
    one.
    """
    if before.sample is None or after.sample is None:
        return measure_change(*(noisy(each.mean, each.variance, exposure, k) for k, each in enumerate((before, after), start=1)))
    return measure_change(_moved(before.mean, before.sample, exposure), _moved(after.mean, after.sample, exposure))


def noisy(reference_image: Image, variance: Image, exposure: float, stream: int = 0) -> Pair:
    """The reference plus one seeded draw of its noise, against itself. Each stream is a draw of its own."""
    draw = np.random.default_rng(stream).standard_normal(reference_image.shape[:2])
    return _moved(reference_image, draw[..., None] * np.sqrt(variance.astype(np.float64)), exposure)


def _moved(reference_image: Image, by: Image, exposure: float) -> Pair:
    return Pair(np.maximum(reference_image + by, 0.0), reference_image, exposure)


def reference_too_noisy(row: Mapping[str, float | None], limit: float = TOO_NOISY) -> bool:
    """Whether the reference leaves more than `limit` of the pixels undecided (0.20 in reports, 0.05 for claims)."""
    surely, possibly = row.get("over_2pct_surely"), row.get("over_2pct_possibly")
    return surely is not None and possibly is not None and possibly - surely > limit
