"""Compare images with the registry's metrics: one image, a sequence, and what the reference's own noise would measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from reports.metrics import Pair, flicker
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


def compare_sequence(pairs: Sequence[Pair], *, nightly: bool = False) -> tuple[list[Row], float | None, int]:
    """Rows per frame, flicker (None for one frame), and the index of the worst frame by RMSE. Raises ValueError without frames."""
    if not pairs:
        raise ValueError("a sequence needs at least one frame")
    rows = [measure(pair, nightly=nightly) for pair in pairs]
    errors = [row["rmse"] or 0.0 for row in rows]
    return rows, flicker(pairs), errors.index(max(errors))


def noise_floor(reference_image: Image, variance: Image, exposure: float = 1.0) -> Row:
    """Metrics that the reference's noise alone produces: the reference plus one seeded draw of its noise, against itself.

    variance (H, W, 3) is that of the mean. The draw moves a pixel's three channels together (they share their light paths), which
    is the largest change of luminance that these variances allow: the floor is not too low.
    """
    draw = np.random.default_rng(0).standard_normal(reference_image.shape[:2])
    noisy = reference_image + draw[..., None] * np.sqrt(variance.astype(np.float64))
    return measure(Pair(np.maximum(noisy, 0.0), reference_image, exposure))


def reference_too_noisy(row: Mapping[str, float | None], limit: float = TOO_NOISY) -> bool:
    """Whether the reference leaves more than `limit` of the pixels undecided (0.20 in reports, 0.05 for claims)."""
    surely, possibly = row.get("over_2pct_surely"), row.get("over_2pct_possibly")
    return surely is not None and possibly is not None and possibly - surely > limit
