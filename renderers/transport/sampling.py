"""Random numbers and the points and directions made of them.

All randomness comes from Philox generators keyed by (seed, stream): the same numbers in any process, at any thread count, and one
stream never moves when another draws more.
"""

from __future__ import annotations

from typing import Literal, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World

F64 = NDArray[np.float64]
Sampler = Literal["uniform", "low-discrepancy"]


class SurfacePoints(NamedTuple):
    """Points on triangles: triangle int64 (N,), barycentrics u (second vertex) and v (third vertex) float64 (N,)."""

    triangle: NDArray[np.int64]
    u: F64
    v: F64


def generator(seed: int, stream: str) -> np.random.Generator:
    """The generator of one named stream of a seed (any non-negative int)."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, crc32(stream.encode())])))


def lattice(count: int, dimensions: int) -> F64:
    """Rank-1 additive lattice in [0, 1)^d of the generalised golden ratio (Roberts 2018, "R2" for d = 2), float64 (count, d)."""
    ratio = 2.0
    for _ in range(64):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1, dimensions + 1)
    return np.asarray((0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0)


def uniform_numbers(count: int, dimensions: int, rng: np.random.Generator, sampler: Sampler = "uniform") -> F64:
    """Points in [0, 1)^d, float64 (count, d): independent, or a Sobol' sequence with Owen scrambling (each point is uniform)."""
    if sampler == "uniform":
        return rng.random((count, dimensions))
    from scipy.stats import qmc  # a third of a second, which most methods need not spend

    power = max(count - 1, 0).bit_length()
    points = qmc.Sobol(dimensions, scramble=True, bits=32, rng=rng).random_base2(power)[:count]
    return np.asarray(np.minimum(points, np.nextafter(1.0, 0.0)))


def surface_points(world: World, count: int, seed: int, sampler: Sampler = "uniform") -> SurfacePoints:
    """`count` area-uniform points on all surfaces of a World (density 1/|S|): triangle by cumulative area, square folded into it.

    b, c ∈ [0, 1): V0 + b·V01 + c·V02 if b + c < 1, else V0 + (1-b)·V02 + (1-c)·V01 (thesis Laurent 2018, algorithm 2)."""
    numbers = uniform_numbers(count, 3, generator(seed, "surface points"), sampler)
    return fold(pick(world.areas, numbers[:, 0]), numbers[:, 1], numbers[:, 2])


def pick(weights: F64, number: F64) -> NDArray[np.int64]:
    """Indices drawn with probability ∝ weights (≥ 0, positive sum), by inversion of numbers in [0, 1); same shape."""
    cumulative = np.cumsum(weights, dtype=np.float64)
    last = int(np.flatnonzero(weights)[-1])
    return np.asarray(np.minimum(np.searchsorted(cumulative, number * cumulative[-1], side="right"), last), np.int64)


def fold(triangle: NDArray[np.int64], b: F64, c: F64) -> SurfacePoints:
    """Square numbers folded into the triangle; area-uniform for uniform b, c."""
    outside = b + c >= 1
    return SurfacePoints(triangle, np.where(outside, 1 - c, b), np.where(outside, 1 - b, c))


def frame(n: F64) -> tuple[F64, F64]:
    """Two unit tangents (N, 3) that make (s, t, n) right-handed, continuous but at n_z = 0 (Duff et al. 2017)."""
    sign = np.where(n[:, 2] >= 0, 1.0, -1.0)
    a = -1 / (sign + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    s = np.stack([1 + sign * n[:, 0] ** 2 * a, sign * b, -sign * n[:, 0]], axis=1)
    t = np.stack([b, sign + n[:, 1] ** 2 * a, -n[:, 1]], axis=1)
    return s, t


def cosine_hemisphere(n: F64, random: F64) -> F64:
    """Unit directions about n, density cos/π; n (N, 3), random (N, 2) in [0, 1)."""
    r, phi = np.sqrt(random[:, 0]), 2 * np.pi * random[:, 1]
    s, t = frame(n)
    up = np.sqrt(1 - random[:, 0])
    return np.asarray((r * np.cos(phi))[:, None] * s + (r * np.sin(phi))[:, None] * t + up[:, None] * n)


def uniform_sphere(random: F64) -> F64:
    """Unit directions, density 1/(4π); random (N, 2) in [0, 1)."""
    z, phi = 1 - 2 * random[:, 0], 2 * np.pi * random[:, 1]
    r = np.sqrt(np.maximum(0, 1 - z * z))
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
