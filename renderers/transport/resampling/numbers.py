"""The random integers of vertices, lattice points and points: hashes of their index and a key, so that nothing is stored.

    a(i, key) = mix(mix(i) ⊕ key)            mix: a bijection of 32-bit integers with little bias (Wellons 2018, "lowbias32")

A triangle's number is a(v₀) ⊕ a(v₁) ⊕ a(v₂) (Laurent 2018, equation 5.14): of its vertices alone, whatever they do and wherever the
triangle stands in its list. There are two such numbers, from two keys: 32 bits that keep or drop, and 16 + 16 that place the point
(the thesis takes 16 + 8 + 8 bits of one, which drops whatever should be kept with a probability under 2⁻¹⁷).

All functions take and return unsigned 32-bit values held in uint64, numbers or arrays, and run in numba and in numpy (`.py_func`).
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.sampling import generator

U64 = NDArray[np.uint64]
STREAM = "point resampling"
SIXTEEN, FIFTEEN, MASK = np.uint64(16), np.uint64(15), np.uint64(0xFFFFFFFF)
FIRST, SECOND = np.uint64(0x7FEB352D), np.uint64(0x846CA68B)


def keys(seed: int) -> tuple[np.uint64, np.uint64]:
    """The two keys of a seed: of the numbers that keep, and of those that place."""
    first, second = generator(seed, STREAM).integers(1 << 32, size=2, dtype=np.uint64)
    return np.uint64(first), np.uint64(second)


@numba.njit(cache=True)
def mix(x):  # type: ignore[no-untyped-def]
    """A bijection of [0, 2³²): every output bit depends on every input bit."""
    x = ((x ^ (x >> SIXTEEN)) * FIRST) & MASK
    x = ((x ^ (x >> FIFTEEN)) * SECOND) & MASK
    return x ^ (x >> SIXTEEN)


@numba.njit(cache=True)
def number(index, key):  # type: ignore[no-untyped-def]
    """The random integer of `index` under `key`."""
    return mix(mix(index) ^ key)


@numba.njit(cache=True)
def placed(number):  # type: ignore[no-untyped-def]
    """(b, c) with V₀ + b·V₀₁ + c·V₀₂ uniform on a triangle: 16 bits each, at the centres of their cells, folded at b + c ≥ 1.

    Point reflection about the middle of the edge: (1 - b)·V₀₁ + (1 - c)·V₀₂. The thesis prints the two swapped.
    """
    b = (np.float32(number & np.uint64(0xFFFF)) + np.float32(0.5)) * np.float32(1 / 65536)
    c = (np.float32(number >> SIXTEEN) + np.float32(0.5)) * np.float32(1 / 65536)
    if b + c >= np.float32(1):
        return np.float32(1) - b, np.float32(1) - c
    return b, c


def further(first: U64, second: U64, count: int) -> NDArray[np.float64]:
    """`count` more uniform numbers in [0, 1) of each point, float64 (N, count), from its two numbers; they move with the point."""
    bijection: Any = mix.py_func
    seed = bijection(first ^ bijection(second ^ np.uint64(0x9E3779B9)))
    columns = [bijection(seed ^ bijection(np.uint64(k + 1))) for k in range(count)]
    return (np.stack(columns, axis=-1).astype(np.float64) + 0.5) / 2.0**32
