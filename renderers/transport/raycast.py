"""Ray casting through Embree: closest hits and shadow segments in a World.

Rays that start or end on a surface are moved off it along the geometric normal, to the side they leave to, by `OFFSET` times the
size of the world (1): the same rule, and nearly the same length, as Mitsuba's. embreex answers in one thread but releases the GIL,
so chunks of rays run in a thread pool (measured: two threads cast twice as many rays per second as one). A ray's answer depends on
that ray alone, hence not on the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray

from renderers.scene.world import World
from renderers.transport.threads import chunks, in_threads

OFFSET = 1e-4
CHUNK = 1 << 16
CACHED_WORLDS = 4
FAR = np.float32(1e30)


class Hits(NamedTuple):
    """Closest hits. triangle int32 (N,), -1 for a miss; t float32 (N,) in lengths of the direction; barycentrics u, v float32 (N,).

    The hit point is (1 - u - v)·p0 + u·p1 + v·p2. t, u and v of a miss are 0.
    """

    triangle: NDArray[np.int32]
    t: NDArray[np.float32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]


class RayCaster:
    """Embree's view of one World. Build it with `caster_of`, which keeps it as long as the World lives."""

    def __init__(self, world: World) -> None:
        self._scene = EmbreeScene(robust=True)
        vertices = np.ascontiguousarray(world.positions, np.float32)
        self._mesh = TriangleMesh(self._scene, vertices, np.ascontiguousarray(world.triangles, np.int32))

    def first_hit(self, origins: ArrayLike, directions: ArrayLike) -> Hits:
        """Closest hits along rays; origins, directions (N, 3), directions of any length. Callers move origins off surfaces."""
        o, d = _rays(origins, directions)
        n = len(o)
        hits = Hits(np.full(n, -1, np.int32), np.zeros(n, np.float32), np.zeros(n, np.float32), np.zeros(n, np.float32))

        def cast(part: slice) -> None:
            found = self._scene.run(o[part], d[part], output=1)
            hit = found["primID"] >= 0
            hits.triangle[part] = found["primID"]
            for target, key in ((hits.t, "tfar"), (hits.u, "u"), (hits.v, "v")):
                target[part] = np.where(hit, found[key], 0)

        in_threads(cast, chunks(n, CHUNK))
        return hits

    def occluded(self, origins: ArrayLike, directions: ArrayLike, distances: ArrayLike) -> NDArray[np.bool_]:
        """Whether anything lies on origin + s·direction for 0 < s < distance; (N, 3), (N, 3), (N,) or scalar, inf allowed."""
        o, d = _rays(origins, directions)
        n = len(o)
        blocked = np.zeros(n, bool)
        reach = np.minimum(np.broadcast_to(np.asarray(distances, np.float32), (n,)), FAR)

        def cast(part: slice) -> None:
            blocked[part] = self._scene.run(o[part], d[part], np.ascontiguousarray(reach[part]), query="OCCLUDED") == 0

        in_threads(cast, chunks(n, CHUNK))
        return blocked

    def occluded_unthreaded(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], distances: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """`occluded` in the calling thread, for callers that run their own threads; C-contiguous float32 arrays."""
        if not len(origins):
            return np.zeros(0, bool)
        return np.asarray(self._scene.run(origins, directions, distances, query="OCCLUDED") == 0)


_CASTERS: WeakKeyDictionary[World, RayCaster] = WeakKeyDictionary()


def caster_of(world: World) -> RayCaster:
    """The World's RayCaster, built once; at most CACHED_WORLDS are kept, and none longer than its World."""
    caster = _CASTERS.get(world)
    if caster is None:
        while len(_CASTERS) >= CACHED_WORLDS:
            _CASTERS.pop(next(iter(_CASTERS)))
        caster = _CASTERS[world] = RayCaster(world)
    return caster


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
