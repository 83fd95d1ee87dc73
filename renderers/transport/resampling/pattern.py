"""How OpenGL's tessellator cuts a triangle when all four levels are n, with equal spacing; and which n to ask for.

Barycentric coordinates are multiples of 1/(3n). Ring j is a triangle whose sides have n - 2j segments; between two rings lies a
strip; odd n end with a triangle in the middle, even n with a point. All parts have 2/(3n²) of the area, but the middle one of odd
n, which has 1/n²: 1.5 times as much. So odd n can leave a part larger than asked for, whose surplus the thesis's rule (5.15, 5.16)
loses: up to 3.4 % of the points. `level` therefore gives even n only.

The diagonals of a strip are the implementation's own; here they turn round at the middle of a side, as in Direct3D's definition and
in Mesa. A device with others draws other points of the same density.
"""

from __future__ import annotations

from functools import cache
from math import ceil, sqrt
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

Rule = Literal["even", "printed"]
LARGEST = 64
MOST = 3 * LARGEST**2 // 2


def count(n: int) -> int:
    """T(n): parts at level n."""
    return (3 * n * n - n % 2) // 2


def printed_level(parts: int) -> int:
    """#S of equation 5.16 as printed: the smallest n with T(n) ≥ parts. Kept to show what it loses."""
    return min(2 * ceil(sqrt(parts / 6)), 1 + ceil(sqrt(1 + 2 * (parts - 1) / 3) - 1))


@numba.njit(cache=True)
def level(ratio, even):  # type: ignore[no-untyped-def]
    """Level for a triangle of `ratio` × the area of one point, 2 … 64: even, the smallest with 3/2·n² ≥ ratio; else as printed."""
    if even:
        n = 2 * int(np.ceil(np.sqrt(ratio / np.float32(6))))
        while n > 2 and np.float32(1.5) * np.float32((n - 2) * (n - 2)) >= ratio:
            n -= 2
        while np.float32(1.5) * np.float32(n * n) < ratio:
            n += 2
    else:
        n, parts = 1, np.ceil(ratio)
        while (3 * n * n - n % 2) // 2 < parts:
            n += 1
    return max(1, min(n, LARGEST))


@cache
def pattern(n: int) -> NDArray[np.int64]:
    """The T(n) parts as lattice points 3n·(u, v), u and v being the weights of the second and third corner: int64 (T(n), 3, 2).

    The corners of a part ascend in (u, v), so that its point doesn't depend on where the tessellator starts.
    """
    parts: list[NDArray[np.int64]] = []
    for ring in range((n + 1) // 2):
        sides, inner = n - 2 * ring, n - 2 * ring - 2
        corners, inside = _corners(n, ring), _corners(n, ring + 1)
        if sides == 1:
            parts.append(corners[None])
            continue
        for a in range(3):
            b = (a + 1) % 3
            edge = _between(corners[a], corners[b], sides)
            strip = _between(inside[a], inside[b], inner)
            parts += [_strip(edge, strip)]
    triangles = np.concatenate(parts)[:, :, 1:]
    order = np.argsort(triangles[..., 0] * 4096 + triangles[..., 1], axis=1)
    return np.ascontiguousarray(np.take_along_axis(triangles, order[..., None], axis=1))


def shares(n: int) -> NDArray[np.float64]:
    """Area of each part over the whole, float64 (T(n),): exact."""
    p = pattern(n)
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / (9.0 * n * n))


def _corners(n: int, ring: int) -> NDArray[np.int64]:
    """Corners of a ring, int64 (3, 3), in units of 1/(3n)."""
    return np.full((3, 3), 2 * ring) + np.eye(3, dtype=np.int64) * (3 * n - 6 * ring)


def _between(a: NDArray[np.int64], b: NDArray[np.int64], segments: int) -> NDArray[np.int64]:
    """Points of a side, int64 (segments + 1, 3); one point where the ring is one."""
    if segments == 0:
        return a[None]
    return np.asarray(a + np.arange(segments + 1)[:, None] * (b - a) // segments)


def _strip(edge: NDArray[np.int64], inner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles between a side and the next ring's, which has two segments fewer; int64 (…, 3, 3)."""
    quads = len(inner) - 1
    found = [(edge[0], edge[1], inner[0]), (edge[-2], edge[-1], inner[-1])]
    for k in range(quads):
        low, high, near, far = edge[k + 1], edge[k + 2], inner[k], inner[k + 1]
        found += [(low, near, far), (low, high, far)] if 2 * k < quads else [(low, high, near), (high, near, far)]
    return np.array(found)
