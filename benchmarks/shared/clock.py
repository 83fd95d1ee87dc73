"""Seconds that a call takes."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def measured(work: Callable[[], object], repeats: int = 3) -> tuple[float, float]:
    """Median wall and CPU seconds of a call, all threads, over `repeats` calls. What has to be compiled must have been before."""
    walls, cpus = [], []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return float(np.median(walls)), float(np.median(cpus))


def best_of(work: Callable[[], object], repeats: int = 3) -> float:
    """Least wall seconds of a call, over `repeats` calls."""
    walls = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        walls.append(time.perf_counter() - start)
    return min(walls)
