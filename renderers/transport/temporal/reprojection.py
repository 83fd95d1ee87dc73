"""Hits of polar hemispheres, moved with their objects and drawn into the same hemispheres: the nearest wins, holes are filled.

1  Each cell whose hit stays covers itself, at its distance. Each cell whose hit moves covers F × F points of its own on the tangent
   plane of the hit, which all move as the hit does.
2  They are drawn into a hemisphere with F × F times as many cells; the nearest wins.
3  What receives nothing is a hole and takes its deepest neighbour, the local background, again and again until none is left.
4  Cells are the means of their F × F parts.                                              Gautron 2006, section 5.4.2, with F = 1

Drawn as single points (F = 1) at the centres of cells, hits that move by less than half a cell fall back into their own: no change
is seen. Jittered points leave it by chance, those near a border first. F = 4 sees an eighth of a cell, and closes cracks.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.hemisphere import Grid
from renderers.transport.temporal.sampling import Cast

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
SNAP = 1e-6  # of a cell, added before rounding down, so that what stays where it is doesn't leave its cell
STRETCH = 2.0  # a point of a footprint lies between 1/STRETCH and STRETCH times as far as its hit, or as far as it
NEAREST = 1e-6


class Moved(NamedTuple):
    """Hits with their places one frame later. ray int64 (S,); before, after, geometric float64 (S, 3); moves bool (S,)."""

    ray: NDArray[np.int64]
    before: F64
    after: F64
    geometric: F64
    moves: NDArray[np.bool_]

    def rows(self, part: slice) -> Moved:
        """Some of them."""
        columns: Any = (column[part] for column in self)
        return Moved(*columns)


def reprojected(cast: Cast, moved: Moved, radiance: F32, grid: Grid, footprints: int, solid: bool = False) -> tuple[F32, F32]:
    """Radiance (R, 3) and nearness (R,) after the motion; radiance (R, 3): of each ray's hit, where it is then.

    solid: cells are of equal solid angle, else of equal projected solid angle.
    """
    first = np.searchsorted(moved.ray, np.arange(len(cast.tangents) + 1) * grid.cells)
    out, near = radiance.copy(), cast.found.nearness.copy()
    shape = grid.rings * footprints, grid.sectors * footprints
    depth, source = np.empty(shape, np.float32), np.empty(shape, np.int64)
    for k in range(len(cast.tangents)):
        part = slice(first[k], first[k + 1])
        if not moved.moves[part].any():
            continue
        rays = slice(k * grid.cells, (k + 1) * grid.cells)
        axes = np.concatenate([cast.tangents[k], cast.sites.normal[k : k + 1]])
        here = moved.rows(part)
        here = here._replace(ray=here.ray - k * grid.cells)
        holes = _draw(*grid, solid, footprints, axes, cast.origins[rays], here, cast.found.nearness[rays], depth, source)
        filled(depth, source, holes, True)
        _average(footprints, depth, source, radiance[rays], out[rays], near[rays])
    return out, near


@numba.njit(nogil=True, cache=True)
def filled(depth, source, holes, cyclic):  # type: ignore[no-untyped-def]
    """Fill holes (H,), flat indices where `source` is -1, with the deepest of their neighbours; returns the passes it took.

    depth, source (rings, sectors): distance and number of what each cell shows. All holes of a pass are filled at once.
    cyclic: the last column lies beside the first. What is holes alone stays so.
    """
    passes, columns = 0, depth.shape[1]
    while len(holes):
        deepest = _deepest(depth, source, holes, cyclic)
        if deepest.max() < 0:
            return passes
        # what is read was known before this pass
        for h in range(len(holes)):
            hole, other = holes[h], deepest[h]
            if other >= 0:
                depth[hole // columns, hole % columns] = depth[other // columns, other % columns]
                source[hole // columns, hole % columns] = source[other // columns, other % columns]
        holes, passes = holes[deepest < 0], passes + 1
    return passes


@numba.njit(nogil=True, cache=True)
def _draw(rings, sectors, solid, f, axes, origins, moved, nearness, depth, source):  # type: ignore[no-untyped-def]
    """Steps 1 and 2; returns the holes. axes (3, 3): tangents and normal."""
    for j in range(rings * f):
        for k in range(sectors * f):
            depth[j, k], source[j, k] = np.inf, -1
    leaves = np.zeros(rings * sectors, np.bool_)
    for s in range(len(moved.ray)):
        leaves[moved.ray[s]] = moved.moves[s]
    for cell in range(rings * sectors):
        if not leaves[cell]:
            distance = 1 / nearness[cell] if nearness[cell] > 0 else np.inf
            for a in range(f):
                for b in range(f):
                    depth[cell // sectors * f + a, cell % sectors * f + b] = distance
                    source[cell // sectors * f + a, cell % sectors * f + b] = cell
    for s in range(len(moved.ray)):
        if moved.moves[s]:
            _footprint(rings, sectors, solid, f, axes, origins, moved, s, depth, source)
    holes = np.empty(rings * sectors * f * f, np.int64)
    count = 0
    for cell in range(rings * sectors):
        if leaves[cell]:
            for a in range(f):
                for b in range(f):
                    j, k = cell // sectors * f + a, cell % sectors * f + b
                    if source[j, k] < 0:
                        holes[count] = j * sectors * f + k
                        count += 1
    return holes[:count].copy()


@numba.njit(nogil=True, cache=True)
def _footprint(rings, sectors, solid, f, axes, origins, moved, s, depth, source):  # type: ignore[no-untyped-def]
    """Draw the points of one moving hit."""
    cell = moved.ray[s]
    offset, away = np.empty(3), np.empty(3)
    facing, reach = 0.0, 0.0
    for c in range(3):
        offset[c] = moved.before[s, c] - origins[cell, c]
        facing += offset[c] * moved.geometric[s, c]
        reach += offset[c] ** 2
    reach = np.sqrt(reach)
    for a in range(f):
        for b in range(f):
            if f == 1:
                for c in range(3):
                    away[c] = moved.after[s, c] - origins[cell, c]
            else:
                square = (cell // sectors + (a + 0.5) / f) / rings
                square = square * (2 - square) if solid else square  # sin² θ, with cos θ = 1 - (j + a) / M
                phi = 2 * np.pi * (cell % sectors + (b + 0.5) / f) / sectors
                sine, slope = np.sqrt(square), 0.0
                x, y, z = sine * np.cos(phi), sine * np.sin(phi), np.sqrt(1 - square)
                for c in range(3):
                    away[c] = x * axes[0, c] + y * axes[1, c] + z * axes[2, c]
                    slope += away[c] * moved.geometric[s, c]
                along = facing / slope if slope * facing > 0 else reach
                if along < reach / STRETCH or along > reach * STRETCH:
                    along = reach
                for c in range(3):
                    away[c] = away[c] * along + moved.after[s, c] - moved.before[s, c]
            _point(rings * f, sectors * f, solid, axes, away, cell, depth, source)


@numba.njit(nogil=True, cache=True)
def _point(rings, sectors, solid, axes, away, number, depth, source):  # type: ignore[no-untyped-def]
    """Draw one point at `away` from the record, if it lies above its horizon."""
    square, x, y, z = 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        square += away[c] ** 2
        x += away[c] * axes[0, c]
        y += away[c] * axes[1, c]
        z += away[c] * axes[2, c]
    if z <= NEAREST or square <= NEAREST**2:
        return
    height = 1 - z / np.sqrt(square) if solid else (x * x + y * y) / square
    j = int(height * rings + SNAP)
    turn = np.arctan2(y, x) / (2 * np.pi)
    k = int((turn + 1 if turn < 0 else turn) * sectors + SNAP) % sectors
    distance = np.float32(np.sqrt(square))
    if j < rings and distance < depth[j, k]:
        depth[j, k], source[j, k] = distance, number


@numba.njit(nogil=True, cache=True)
def _deepest(depth, source, holes, cyclic):  # type: ignore[no-untyped-def]
    """For each hole its deepest known neighbour of eight, as a flat index, or -1."""
    rings, sectors = depth.shape
    out = np.full(len(holes), -1, np.int64)
    for h in range(len(holes)):
        row, column = holes[h] // sectors, holes[h] % sectors
        far = -1.0
        for dj in range(-1, 2):
            for dk in range(-1, 2):
                j, k = row + dj, column + dk
                if cyclic:
                    k %= sectors
                if 0 <= j < rings and 0 <= k < sectors and source[j, k] >= 0 and depth[j, k] > far:
                    far = depth[j, k]
                    out[h] = j * sectors + k
    return out


@numba.njit(nogil=True, cache=True)
def _average(f, depth, source, radiance, out, near):  # type: ignore[no-untyped-def]
    """out (cells, 3), near (cells,): means of radiance (cells, 3) and 1/depth over the parts of each cell; 0: unknown."""
    rings, sectors = depth.shape[0] // f, depth.shape[1] // f
    total = np.empty(3)
    for cell in range(rings * sectors):
        total[:] = 0
        close = 0.0
        for a in range(f):
            for b in range(f):
                j, k = cell // sectors * f + a, cell % sectors * f + b
                if source[j, k] < 0:
                    continue
                for c in range(3):
                    total[c] += radiance[source[j, k], c]
                close += 1 / max(depth[j, k], NEAREST)
        for c in range(3):
            out[cell, c] = total[c] / (f * f)
        near[cell] = close / (f * f)
