"""Milliseconds of each metric at 1280×720: `python -m benchmarks.metrics`."""

from __future__ import annotations

import numpy as np

from benchmarks.shared.clock import best_of
from reports.metrics import Pair
from reports.registry import METRICS


def main() -> None:
    """Print the best of a few runs for each metric, image preparation included, and for all of them together."""
    rng = np.random.default_rng(0)
    reference = rng.random((720, 1280, 3), dtype=np.float32)
    test = reference * (1 + 0.02 * rng.standard_normal(reference.shape, dtype=np.float32))
    variance = np.full((720, 1280), 1e-6, np.float32)

    def pair() -> Pair:
        return Pair(test, reference, 1.0, variance, 16)

    for metric in METRICS.values():
        if metric.function is not None:
            print(f"{metric.id:20s} {1000 * best_of(lambda f=metric.function: f(pair())):8.1f} ms")  # type: ignore[misc]

    def together() -> None:
        shared = pair()
        for metric_id in ("rmse", "ssim", "over_2pct"):
            function = METRICS[metric_id].function
            assert function is not None
            function(shared)

    print(f"{'rmse+ssim+over_2pct':20s} {1000 * best_of(together):8.1f} ms")


if __name__ == "__main__":
    main()
