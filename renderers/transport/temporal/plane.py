"""Samples of square planes, moved and drawn into the same planes: pixel-sized points, the nearest wins, holes are filled.

Planes lie at z = 1 of the axes of their records and cover [-h, h]² with M × M pixels [x, y], as those of `caching.plane`. Pixels
that receive nothing take their deepest neighbour, the local background, again and again until none is left; where a plane receives
nothing at all, nothing is seen. GL twin: `renderers.gl.reprojection`.                             Gautron 2006, section 5.4.2
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.temporal.reprojection import filled
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
Floats = NDArray[np.floating]
PLANES_PER_TASK = 16
# float32, as on a GPU
BEHIND, SNAP, HALF, ONE = np.float32(1e-6), np.float32(1e-6), np.float32(0.5), np.float32(1)


class Drawn(NamedTuple):
    """K images: source int32 (K, M, M), number of the point in each pixel, -1 in a plane that received none; depth float32 (K, M,
    M), along the normal; holes bool (K, M, M): pixels that received nothing before they were filled."""

    source: NDArray[np.int32]
    depth: F32
    holes: NDArray[np.bool_]


Draw = Callable[[F32, int, float], tuple[NDArray[np.int32], F32, NDArray[np.bool_]]]


def reprojected(points: Floats, side: int = 64, half: float = 2.0) -> Drawn:
    """Points (K, N, 3) relative to K records, in their axes, drawn into planes z = 1 of side² pixels [x, y] over [-half, half]²."""
    points = np.asarray(points, np.float32)
    shape = len(points), side, side
    drawn = Drawn(np.full(shape, -1, np.int32), np.zeros(shape, np.float32), np.zeros(shape, bool))

    def task(part: slice) -> None:
        _planes(points[part], np.float32(half), *(column[part] for column in drawn))

    in_threads(task, chunks(len(points), PLANES_PER_TASK))
    return drawn


@numba.njit(nogil=True, cache=True)
def _planes(points, half, source, depth, holes):  # type: ignore[no-untyped-def]
    side = source.shape[1]
    for k in range(len(points)):
        _draw(points[k], half, source[k], depth[k])
        empty = np.flatnonzero(source[k].ravel() < 0)
        for pixel in empty:
            holes[k, pixel // side, pixel % side] = True
        filled(depth[k], source[k], empty, False)


@numba.njit(nogil=True, cache=True)
def _draw(points, half, source, depth):  # type: ignore[no-untyped-def]
    """Of equally near points the last, as drawing from far to near has it."""
    side, scale = len(source), np.float32(len(source))
    for i in range(len(points)):
        z = points[i, 2]
        if not z > BEHIND:
            continue
        row = np.floor((points[i, 0] / z / half + ONE) * HALF * scale + SNAP)
        column = np.floor((points[i, 1] / z / half + ONE) * HALF * scale + SNAP)
        if 0 <= row < side and 0 <= column < side:
            j, k = int(row), int(column)
            if source[j, k] < 0 or z <= depth[j, k]:
                source[j, k], depth[j, k] = i, z
