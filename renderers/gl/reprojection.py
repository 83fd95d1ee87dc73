"""Hemisphere samples of square planes, moved and drawn into the same planes: twin of `transport.temporal.plane.Plane.reprojected`.

Two passes over the points: the least depth of each pixel by `atomicMin` of its bits, then of the points at that depth the last, as
drawing from far to near has it. Then passes over the pixels fill holes with their deepest neighbour, until none is left. Nothing
depends on the order in which invocations run.                                              Gautron 2006, section 5.4.2
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gl.context import check, context
from renderers.gl.programs import assign, compute

POINTS, DEPTHS, SOURCES = 4, 5, 6
NOWHERE = 0xFFFFFFFF
LOCAL, ROW = 64, 1 << 10
BATCH = 1 << 20


class Reprojected(NamedTuple):
    """K images: source int32 (K, M, M), number of the point in each pixel; depth float32 (K, M, M), along the normal; holes bool
    (K, M, M): pixels that received nothing before they were filled."""

    source: NDArray[np.int32]
    depth: NDArray[np.float32]
    holes: NDArray[np.bool_]


def reprojected(points: NDArray[np.floating], side: int = 64, half: float = 2.0) -> Reprojected:
    """Points (K, N, 3) relative to K records, in their axes u, v, n, drawn into planes of side² pixels over [-half, half]².

    Raises ValueError where a plane receives no point at all, GLError.
    """
    points = np.asarray(points, np.float32)
    size = max(1, BATCH // max(points.shape[1], side * side))
    parts = [_batch(points[start : start + size], side, half) for start in range(0, len(points), size)]
    shape = 0, side, side
    empty = Reprojected(np.zeros(shape, np.int32), np.zeros(shape, np.float32), np.zeros(shape, np.bool_))
    return Reprojected(*(np.concatenate(column) for column in zip(empty, *parts, strict=True)))


def _batch(points: NDArray[np.float32], side: int, half: float) -> Reprojected:
    ctx, (count, each) = context(), points.shape[:2]
    pixels = count * side * side
    rows = np.zeros((count * each, 4), np.float32)
    rows[:, :3] = points.reshape(-1, 3)
    cloud, depths = ctx.buffer(rows.tobytes()), ctx.buffer(np.full(pixels, NOWHERE, np.uint32).tobytes())
    sources = ctx.buffer(np.full(pixels, -1, np.int32).tobytes())
    for unit, buffer in ((POINTS, cloud), (DEPTHS, depths), (SOURCES, sources)):
        buffer.bind_to_storage_buffer(unit)
    draw = compute("reproject.comp.glsl")
    for choose in (False, True):
        _run(draw, count * each, each=each, side=side, half_width=half, choose=choose)
    holes = np.frombuffer(sources.read(), np.int32) < 0
    depths, sources = _filled(depths, sources, side, pixels, int(holes.sum()))
    shape = count, side, side
    out = Reprojected(
        np.frombuffer(sources.read(), np.int32).reshape(shape).copy(),
        np.frombuffer(depths.read(), np.float32).reshape(shape).copy(),
        holes.reshape(shape),
    )
    check(ctx, "reprojection")
    for buffer in (cloud, depths, sources):
        buffer.release()
    return out


def _filled(depths: Any, sources: Any, side: int, pixels: int, holes: int) -> tuple[Any, Any]:
    """Buffers of depths and sources without holes; the given ones are released where there were any."""
    ctx, fill = context(), compute("reprojection_fill.comp.glsl")
    while holes:
        after = ctx.buffer(reserve=4 * pixels), ctx.buffer(np.zeros(1 + pixels, np.uint32).tobytes())
        for unit, buffer in enumerate((depths, sources, *after), POINTS):
            buffer.bind_to_storage_buffer(unit)
        _run(fill, pixels, side=side)
        found = np.frombuffer(after[1].read(), np.uint32)
        left = int(found[0])
        for buffer in (depths, sources, after[1]):
            buffer.release()
        depths, sources = after[0], ctx.buffer(found[1:].tobytes())
        if left == holes:
            raise ValueError("a hemisphere of holes alone can't be filled")
        holes = left
    return depths, sources


def _run(program: Any, total: int, **uniforms: Any) -> None:
    """So many invocations, in rows of ROW groups: a grid's side is limited to 65,535 groups."""
    assign(program, total=total, **uniforms)
    groups = -(-total // LOCAL)
    program.run(min(groups, ROW), -(-groups // ROW))
    context().memory_barrier()
