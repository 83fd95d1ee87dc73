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
    old, new = _corners(before, found.triangle), _corners(after, found.triangle)
    weights = np.stack([1 - found.u - found.v, found.u, found.v], axis=1)
    shift = np.einsum("nk,nkc->nc", weights, new - old)
    return np.einsum("nij,nkj->nik", _axes(new), _axes(old)), shift


def departures(motion: Motion, sites: Sites) -> tuple[I64, F64, F64]:
    """Which of N places lie on a surface that moves, (M,), and how they go with it: rotation (M, 3, 3) and shift (M, 3)."""
    near = np.zeros(0, np.int64)
    if motion.same_topology and motion.moved.any() and len(sites.position):
        # an anchored place lies at most REACH off its surface
        near = np.flatnonzero(_within(sites.position, motion.boxes[::2], REACH))
    found = anchors(motion.before, sites.rows(near)) if len(near) else Anchors(np.zeros(0, np.int32), np.zeros(0), np.zeros(0))
    going = np.flatnonzero(found.held & motion.moved[found.triangle])
    if not len(going):
        return near[:0], np.zeros((0, 3, 3)), np.zeros((0, 3))
    return near[going], *carried(motion.before, motion.after, found.rows(going))


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


def _corners(world: World, triangle: NDArray[np.int32]) -> F64:
    return np.asarray(world.positions[world.triangles[triangle]], np.float64)


def _axes(corners: F64) -> F64:
    """Orthonormal axes of triangles (N, 3, 3), in columns."""
    edge = corners[:, 1] - corners[:, 0]
    normal = np.cross(edge, corners[:, 2] - corners[:, 0])
    first, last = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in (edge, normal))
    return np.stack([first, np.cross(last, first), last], axis=2)
