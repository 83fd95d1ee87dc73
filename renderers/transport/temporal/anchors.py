"""What surface a place lies on, and where that surface goes.

Places are constants of the world; surfaces aren't. A record whose surface has gone would be renewed inside an object or in mid-air,
where its light is none of any pixel's.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.records import Sites
from renderers.transport.raycast import OFFSET, caster_of
from renderers.transport.surface import turned
from renderers.transport.temporal.motion import Motion

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
REACH = 2 * OFFSET
BURIED = OFFSET / 2  # rays leave from OFFSET above a place: from outside, if the surface lies no higher than this
PARALLEL = 0.95


class Anchors(NamedTuple):
    """Of N places. triangle int32 (N,): the one each lies on, -1 in mid-air; u, v float64 (N,): barycentrics there."""

    triangle: NDArray[np.int32]
    u: F64
    v: F64

    @property
    def held(self) -> NDArray[np.bool_]:
        """Places with a surface, (N,)."""
        return self.triangle >= 0

    def rows(self, index: I64) -> Anchors:
        """The selected ones."""
        return Anchors(self.triangle[index], self.u[index], self.v[index])


def anchors(world: World, sites: Sites) -> Anchors:
    """The surface that each place lies on: parallel to it, at most REACH below it and at most BURIED above."""
    up = turned(sites.geometric, sites.normal)
    hits = caster_of(world).first_hit(sites.position + REACH * up, -up)
    on = (hits.triangle >= 0) & (hits.t <= 2 * REACH) & (hits.t >= REACH - BURIED)
    on[on] = np.abs(np.einsum("ij,ij->i", world.normals_of(hits.triangle[on]), up[on])) >= PARALLEL
    return Anchors(np.where(on, hits.triangle, -1).astype(np.int32), hits.u.astype(np.float64), hits.v.astype(np.float64))


def carried(before: World, after: World, found: Anchors) -> tuple[F64, F64]:
    """How anchored places (all held) move with their triangles: rotation (N, 3, 3) and shift (N, 3) of the place itself."""
    rotation, shift = np.empty((len(found.triangle), 3, 3)), np.empty((len(found.triangle), 3))
    _carry(before.triangles, before.positions, after.positions, *found, rotation, shift)
    return rotation, shift


def departing(motion: Motion, sites: Sites) -> tuple[I64, Anchors]:
    """Which of N places lie on a surface that moves, (M,), and where on it."""
    near = np.zeros(0, np.int64)
    if motion.same_topology and motion.moved.any() and len(sites.position):
        # an anchored place lies at most REACH off its surface
        near = np.flatnonzero(_within(sites.position, motion.boxes[::2], REACH))
    if not len(near):
        return near, Anchors(np.zeros(0, np.int32), np.zeros(0), np.zeros(0))
    found = anchors(motion.before, sites.rows(near))
    going = np.flatnonzero(found.held & motion.moved[found.triangle])
    return near[going], found.rows(going)


def departures(motion: Motion, sites: Sites) -> tuple[I64, F64, F64]:
    """The places of `departing`, and how they go with their surfaces: rotation (M, 3, 3) and shift (M, 3)."""
    index, found = departing(motion, sites)
    return index, *carried(motion.before, motion.after, found)


@numba.njit(nogil=True, cache=True)
def _within(position, boxes, margin):  # type: ignore[no-untyped-def]
    """Which positions (N, 3) lie in one of the boxes (B, 2, 3), grown by a margin: bool (N,)."""
    inside = np.zeros(len(position), np.bool_)
    for i in range(len(position)):
        for b in range(len(boxes)):
            inside[i] = True
            for c in range(3):
                if position[i, c] < boxes[b, 0, c] - margin or position[i, c] > boxes[b, 1, c] + margin:
                    inside[i] = False
            if inside[i]:
                break
    return inside


@numba.njit(nogil=True, cache=True)
def _carry(triangles, before, after, triangle, u, v, rotation, shift):  # type: ignore[no-untyped-def]
    old, new = np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(triangle)):
        a, b, c = triangles[triangle[n]]
        _axes(before, a, b, c, old)
        _axes(after, a, b, c, new)
        for i in range(3):
            shift[n, i] = 0.0
            for vertex, weight in ((a, 1 - u[n] - v[n]), (b, u[n]), (c, v[n])):
                shift[n, i] += weight * (np.float64(after[vertex, i]) - np.float64(before[vertex, i]))
            for j in range(3):
                rotation[n, i, j] = new[0, i] * old[0, j] + new[1, i] * old[1, j] + new[2, i] * old[2, j]


@numba.njit(inline="always")
def _axes(positions, a, b, c, axes):  # type: ignore[no-untyped-def]
    """Orthonormal axes (3, 3) of a triangle, in rows: along its first edge, in its plane across that, along its normal."""
    for i in range(3):
        axes[0, i] = np.float64(positions[b, i]) - np.float64(positions[a, i])
        axes[1, i] = np.float64(positions[c, i]) - np.float64(positions[a, i])
    _across(axes[0], axes[1], axes[2])
    for k in (0, 2):
        axes[k] /= np.sqrt(axes[k, 0] ** 2 + axes[k, 1] ** 2 + axes[k, 2] ** 2)
    _across(axes[2], axes[0], axes[1])


@numba.njit(inline="always")
def _across(x, y, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = x[j] * y[k] - x[k] * y[j]
