"""Hemisphere samples of square planes, moved and drawn into the same planes: twin of `transport.temporal.plane.reprojected`.

One work group draws a plane: the least depth of each pixel by `atomicMin` of its bits, then of the points at that depth the last,
as drawing from far to near has it; then it fills holes with their deepest neighbour, all of a pass at once, until none is left.
Hundreds of planes are one dispatch and one read-back. Nothing depends on the order in which invocations run.
                                                                                                 Gautron 2006, section 5.4.2
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gl.context import check, context
from renderers.gl.programs import assign, compute

POINTS, IMAGES = 4, 5
FILLED, NUMBER = 0x80000000, 0x3FFFFFFF
BATCH = 1 << 20


class Reprojected(NamedTuple):
    """K images: source int32 (K, M, M), number of the point in each pixel, -1 in a plane that received none; depth float32 (K, M,
    M), along the normal; holes bool (K, M, M): pixels that received nothing before they were filled."""

    source: NDArray[np.int32]
    depth: NDArray[np.float32]
    holes: NDArray[np.bool_]


def reprojected(points: NDArray[np.floating], side: int = 64, half: float = 2.0) -> Reprojected:
    """Points (K, N, 3) relative to K records, in their axes, drawn into planes z = 1 of side² pixels [x, y] over [-half, half]².

    Raises GLError.
    """
    points = np.asarray(points, np.float32)
    size = max(1, BATCH // max(points.shape[1], side * side))
    parts = [_batch(points[start : start + size], side, half) for start in range(0, len(points), size)]
    shape = 0, side, side
    empty = Reprojected(np.zeros(shape, np.int32), np.zeros(shape, np.float32), np.zeros(shape, np.bool_))
    return Reprojected(*(np.concatenate(column) for column in zip(empty, *parts, strict=True)))


def _batch(points: NDArray[np.float32], side: int, half: float) -> Reprojected:
    ctx, (count, each) = context(), points.shape[:2]
    cloud, images = ctx.buffer(points.tobytes()), ctx.buffer(reserve=count * 2 * side * side * 4)
    cloud.bind_to_storage_buffer(POINTS)
    images.bind_to_storage_buffer(IMAGES)
    program = compute("reproject.comp.glsl")
    assign(program, each=each, side=side, half_width=half)
    program.run(count)
    ctx.memory_barrier()
    depths, words = np.frombuffer(images.read(), np.uint32).reshape(count, 2, side, side).swapaxes(0, 1)
    check(ctx, "reprojection")
    for buffer in (cloud, images):
        buffer.release()
    known = words > 0
    return Reprojected(
        (words & NUMBER).astype(np.int32) - 1,
        np.where(known, depths.copy().view(np.float32), 0).astype(np.float32),
        (words & FILLED > 0) | ~known,
    )
