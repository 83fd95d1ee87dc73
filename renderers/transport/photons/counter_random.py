"""Random numbers by counter: number (key, photon, dimension) is a hash, so a photon's path never depends on who traces it or when.

Two rounds of the SplitMix64 finaliser (Steele, Lea & Flood 2014; constants of Stafford's mix 13) over key and photon, then over the
dimension; the upper 53 bits make a float64 in [0, 1).
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.sampling import generator

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
FIRST = np.uint64(0xBF58476D1CE4E5B9)
SECOND = np.uint64(0x94D049BB133111EB)
S30, S27, S31, S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


def key_of(seed: int, stream: str) -> np.uint64:
    """The key of one named stream of a seed."""
    return np.uint64(generator(seed, stream).integers(0, 1 << 63, dtype=np.uint64))


@numba.njit(inline="always")
def _mixed(z):  # type: ignore[no-untyped-def]
    z = (z ^ (z >> S30)) * FIRST
    z = (z ^ (z >> S27)) * SECOND
    return z ^ (z >> S31)


@numba.njit(inline="always")
def number(key, photon, dimension):  # type: ignore[no-untyped-def]
    """One float64 in [0, 1); key, photon, dimension uint64."""
    start = _mixed(key + photon * GOLDEN)
    return float(_mixed(start + (dimension + np.uint64(1)) * GOLDEN) >> S11) * 2.0**-53


@numba.njit(nogil=True, cache=True)
def fill_numbers(key, photons, first, out):  # type: ignore[no-untyped-def]
    """out (N, D) = the numbers of photons uint64 (N,), dimensions first … first + D - 1."""
    for i in range(len(photons)):
        for d in range(out.shape[1]):
            out[i, d] = number(key, photons[i], np.uint64(first + d))


def numbers(key: np.uint64, photons: NDArray[np.uint64], first: int, count: int) -> NDArray[np.float64]:
    """Numbers of photons uint64 (N,) in dimensions first … first + count - 1, float64 (N, count) in [0, 1)."""
    out = np.empty((len(photons), count))
    fill_numbers(key, photons, first, out)
    return out
