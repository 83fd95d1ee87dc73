"""Ray casting through Embree: closest hits and shadow segments in a World.

Rays that start or end on a surface are moved off it along the geometric normal, to the side they leave to, by `OFFSET` times the
size of the world (1): the same rule, and nearly the same length, as Mitsuba's. Chunks of rays run in a thread pool: Embree answers
without the GIL. A ray's answer depends on that ray alone, hence neither on the number of threads nor on its neighbours.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple, TypeVar
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.placed import Still
from renderers.scene.world import World, shared_with_other_frames
from renderers.transport.embree import Grid, tree_of
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
OFFSET = 1e-4
CHUNK = 1 << 16
CACHED_WORLDS = 4
FAR = np.float32(1e30)
K = TypeVar("K")
V = TypeVar("V")


class Hits(NamedTuple):
    """Closest hits. triangle int32 (N,), -1 for a miss; t float32 (N,) in lengths of the direction; barycentrics u, v float32 (N,).

    The hit point is (1 - u - v)·p0 + u·p1 + v·p2. t, u and v of a miss are 0.
    """

    triangle: NDArray[np.int32]
    t: NDArray[np.float32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]

    @staticmethod
    def none(count: int) -> Hits:
        """Misses."""
        return Hits(np.full(count, -1, np.int32), *(np.zeros(count, np.float32) for _ in range(3)))

    def part(self, rows: slice) -> Hits:
        """A view of some of them."""
        return Hits._make(column[rows] for column in self)


class _Tree:
    """Embree's tree over some of a World's triangles; index int32 (T,): their numbers, None for all."""

    def __init__(self, world: World, index: NDArray[np.int32] | None = None) -> None:
        self.index = index
        vertices, triangles = world.positions, world.triangles
        if index is not None:
            vertices, triangles = _compact(vertices, triangles[index])
        self._tree = tree_of(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(triangles, np.int32))
        self.blocked = self._tree.blocked

    def nearest(self, origins: F32, directions: F32, grid: Grid | None, hits: Hits) -> None:
        """Replace the hits that this tree's triangles are nearer than."""
        if self.index is None:
            self._tree.nearest(origins, directions, grid, hits)
            return
        own = Hits.none(len(origins))
        self._tree.nearest(origins, directions, grid, own)
        _keep_nearer(tuple(own), self.index, tuple(hits))


class RayCaster:
    """Embree's view of one World. Build it with `caster_of`, which keeps it as long as the World lives.

    Where some of an animated scene stands still, that has a tree of its own, which all frames share.
    """

    def __init__(self, world: World, still: _Tree | None = None, moving: _Tree | None = None) -> None:
        self._trees = [tree for tree in (still, moving) if tree is not None] or [_Tree(world)]
        self._moving = moving if still is not None else None

    def first_hit(self, origins: ArrayLike, directions: ArrayLike, grid: Grid | None = None) -> Hits:
        """Closest hits along rays; origins, directions (N, 3), directions of any length. Callers move origins off surfaces.

        grid: (rows, columns), where the rays are grids whose neighbours start near each other and go nearly the same way: faster.
        """
        return self._closest(self._trees, origins, directions, grid)

    def first_moving_hit(self, origins: ArrayLike, directions: ArrayLike, grid: Grid | None = None) -> Hits | None:
        """`first_hit` of what moves at any time of the animation alone; None where that has no tree of its own."""
        return None if self._moving is None else self._closest([self._moving], origins, directions, grid)

    @staticmethod
    def _closest(trees: list[_Tree], origins: ArrayLike, directions: ArrayLike, grid: Grid | None) -> Hits:
        o, d = _rays(origins, directions)
        hits = Hits.none(len(o))

        def cast(part: slice) -> None:
            for tree in trees:
                tree.nearest(o[part], d[part], grid, hits.part(part))

        whole = 1 if grid is None else grid[0] * grid[1]
        in_threads(cast, chunks(len(o), max(1, CHUNK // whole) * whole))
        return hits

    def occluded(self, origins: ArrayLike, directions: ArrayLike, distances: ArrayLike) -> NDArray[np.bool_]:
        """Whether anything lies on origin + s·direction for 0 < s < distance; (N, 3), (N, 3), (N,) or scalar, inf allowed."""
        o, d = _rays(origins, directions)
        n = len(o)
        blocked = np.zeros(n, bool)
        reach = np.minimum(np.broadcast_to(np.asarray(distances, np.float32), (n,)), FAR)

        def cast(part: slice) -> None:
            blocked[part] = self.occluded_unthreaded(o[part], d[part], np.ascontiguousarray(reach[part]))

        in_threads(cast, chunks(n, CHUNK))
        return blocked

    def occluded_unthreaded(self, origins: F32, directions: F32, distances: F32) -> NDArray[np.bool_]:
        """`occluded` in the calling thread, for callers that run their own threads; C-contiguous float32 arrays."""
        blocked = self._trees[0].blocked(origins, directions, distances)
        for tree in self._trees[1:]:
            blocked |= tree.blocked(origins, directions, distances)
        return blocked


@numba.njit(nogil=True, cache=True)
def _keep_nearer(own, index, hits):  # type: ignore[no-untyped-def]
    """Hits become those of a tree of its own whose triangles are numbered by `index`, where they are nearer."""
    triangle, t, u, v = hits
    for ray in range(len(t)):
        if own[0][ray] >= 0 and (triangle[ray] < 0 or own[1][ray] < t[ray]):
            triangle[ray], t[ray] = index[own[0][ray]], own[1][ray]
            u[ray], v[ray] = own[2][ray], own[3][ray]


_CASTERS: WeakKeyDictionary[World, RayCaster] = WeakKeyDictionary()
_STILL: WeakKeyDictionary[Still, _Tree] = WeakKeyDictionary()


def caster_of(world: World) -> RayCaster:
    """The World's RayCaster, built once; at most CACHED_WORLDS are kept, and none longer than its World."""
    caster = _CASTERS.get(world)
    if caster is None:
        caster = _kept(_CASTERS, world, _caster(world))
    return caster


def _caster(world: World) -> RayCaster:
    """One tree, or that of all that stands still in an animated scene, kept as long as the scene lives, and one of the rest."""
    shared = shared_with_other_frames(world)
    if shared is None or not shared[1].any():
        return RayCaster(world)
    still, stands = shared
    standing = stands[world.instance]
    index = np.flatnonzero(standing).astype(np.int32)
    if not len(index):
        return RayCaster(world)
    tree = _STILL.get(still)
    if tree is None:
        tree = _kept(_STILL, still, _Tree(world, index))
    # the order of a tree's triangles stays, but their numbers change where moving ones before them lose their area
    own = copy(tree)
    own.index = index
    rest = np.flatnonzero(~standing).astype(np.int32)
    return RayCaster(world, own, _Tree(world, rest) if len(rest) else None)


def _kept(cache: WeakKeyDictionary[K, V], key: K, value: V) -> V:
    """Put a value into a cache of at most CACHED_WORLDS, and answer it."""
    while len(cache) >= CACHED_WORLDS:
        cache.pop(next(iter(cache)))
    cache[key] = value
    return value


def _compact(vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """The vertices that triangles use, and the triangles counting those."""
    used = np.zeros(len(vertices), bool)
    used[triangles] = True
    return vertices[used], (np.cumsum(used) - 1)[triangles].astype(np.int32)


def off_surface(points: ArrayLike, normals: ArrayLike, directions: ArrayLike) -> NDArray[np.float64]:
    """Points (N, 3) moved by OFFSET along ±normal (geometric, unit), to the side that `directions` leave to."""
    p, n, d = (np.asarray(a, np.float64) for a in (points, normals, directions))
    side = np.where(np.einsum("ij,ij->i", n, d) < 0, -OFFSET, OFFSET)
    return np.asarray(p + side[:, None] * n)


def segments_blocked(
    caster: RayCaster, points: ArrayLike, normals: ArrayLike, targets: ArrayLike, target_normals: ArrayLike | None = None
) -> NDArray[np.bool_]:
    """Whether segments from surface points to targets are blocked, bool (N,).

    points, normals (geometric), targets: (N, 3). Targets on a surface come with their geometric normals and are moved off it as
    well; free ones (point lights) end OFFSET of the length short.
    """
    towards = np.asarray(targets, np.float64) - np.asarray(points, np.float64)
    start = off_surface(points, normals, towards)
    end = np.asarray(targets, np.float64) if target_normals is None else off_surface(targets, target_normals, -towards)
    return caster.occluded(start, end - start, 1 - OFFSET)


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32)
