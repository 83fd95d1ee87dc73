"""Milliseconds of each metric at 1280×720: `python benchmarks/metrics.py`."""

from __future__ import annotations

import time

import numpy as np

from reports.metrics import Pair
from reports.registry import METRICS

REPEATS = 3


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
            seconds = []
            for _ in range(REPEATS):
                start = time.perf_counter()
                metric.function(pair())
                seconds.append(time.perf_counter() - start)
            print(f"{metric.id:20s} {1000 * min(seconds):8.1f} ms")
    start, shared = time.perf_counter(), pair()
    for metric_id in ("rmse", "ssim", "over_2pct"):
        function = METRICS[metric_id].function
        assert function is not None
        function(shared)
    print(f"{'rmse+ssim+over_2pct':20s} {1000 * (time.perf_counter() - start):8.1f} ms")


if __name__ == "__main__":
    main()
