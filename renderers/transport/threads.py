"""Work spread over threads whose result doesn't depend on how many there are: fixed chunks, results in chunk order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

T = TypeVar("T")
R = TypeVar("R")


def thread_count() -> int:
    """Threads used by ray casting and numba kernels alike: NUMBA_NUM_THREADS, by default the cores of the machine."""
    return int(numba.get_num_threads())


def chunks(count: int, size: int) -> list[slice]:
    """Slices of at most `size` that cover range(count) in order."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def in_threads(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """function(item) for every item, in order. Worth it where the function releases the GIL (embree, nogil kernels)."""
    workers = min(thread_count(), len(items))
    if workers <= 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, items))
