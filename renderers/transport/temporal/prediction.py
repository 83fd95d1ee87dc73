"""Hemispheres one frame ahead.

raycast    the hemisphere of the next frame itself. Rays are cast anew only where they may end elsewhere: those that hit something
           that moves, and those that touch the bounding box of something that moved. What they hit is shaded anew only where its
           light may have changed: by a light, or by what moves across the way to a light. The rest is that of the present frame, so
           the price follows what moves, not the scene. A hemisphere on a surface that moves goes with it: at its old place there
           will be the inside of an object, or nothing.
reproject  hits move with their objects and are drawn into the same hemisphere (Gautron 2006, 5.4.2): only shadow rays
           are cast.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.hemisphere import Grid
from renderers.transport.caching.incoming import Incoming
from renderers.transport.raycast import FAR, OFFSET, Hits, caster_of
from renderers.transport.seen import Seen, seen_along
from renderers.transport.temporal.anchors import Anchors, anchors, carried
from renderers.transport.temporal.motion import Motion, crossing
from renderers.transport.temporal.reprojection import Moved, reprojected
from renderers.transport.temporal.sampling import Cast, TemporalSampler

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


class Shaded(NamedTuple):
    """Light of rays one frame later: radiance float32 (R, 3), nearness float32 (R,), number of shadow rays."""

    radiance: F32
    nearness: F32
    rays: int


class RayCast:
    """The next frame's hemispheres, exactly. sampler: any with the grid of the casts."""

    def __init__(self, motion: Motion, sampler: TemporalSampler, incoming: Incoming) -> None:
        self._motion, self._sampler, self._incoming = motion, sampler, incoming
        self._caster = caster_of(motion.after)

    def __call__(self, cast: Cast) -> tuple[F32, F32, int]:
        """See `sampling.Ahead`."""
        columns: Any = (column.copy() for column in cast.hits)
        hits = Hits(*columns)
        origins, directions, uncertain = self._rays(cast)
        self._doubt(cast, uncertain)
        anew = np.flatnonzero(uncertain)
        if len(anew):
            found = self._caster.first_hit(origins[anew], directions[anew])
            for column, value in zip(hits, found, strict=True):
                column[anew] = value
        changed = np.zeros(len(hits.t), bool)
        changed[anew] = True
        shaded = shaded_later(self._motion, self._incoming, self._sampler, cast, hits, directions, changed)
        return shaded.radiance, shaded.nearness, len(anew) + shaded.rays

    def _rays(self, cast: Cast) -> tuple[F32, F32, Mask]:
        """Origins and directions (R, 3) one frame later, and which rays differ, (R,)."""
        motion, rays = self._motion, np.zeros(len(cast.hits.t), bool)
        if not motion.same_topology or not motion.moved.any():
            return cast.origins, cast.directions, rays
        found = anchors(motion.before, cast.sites)
        index = np.flatnonzero(found.held & motion.moved[found.triangle])
        if not len(index):
            return cast.origins, cast.directions, rays
        moving = Anchors(found.triangle[index], found.u[index], found.v[index])
        rotation, shift = carried(motion.before, motion.after, moving)
        by_place = len(cast.tangents), -1, 3
        origins, directions = (a.reshape(by_place).copy() for a in (cast.origins, cast.directions))
        place = cast.sites.position[index][:, None]
        origins[index] = np.einsum("kij,krj->kri", rotation, origins[index] - place) + place + shift[:, None]
        directions[index] = np.einsum("kij,krj->kri", rotation, directions[index])
        rays.reshape(len(cast.tangents), -1)[index] = True
        return origins.reshape(-1, 3), directions.reshape(-1, 3), rays

    def _doubt(self, cast: Cast, uncertain: Mask) -> None:
        """uncertain (R,) |= whether a ray may hit something else, or elsewhere."""
        if not self._motion.same_topology:
            uncertain[:] = True
            return
        hit = cast.hits.triangle >= 0
        uncertain[hit] |= self._motion.moved[cast.hits.triangle[hit]]
        # what moved away from before a ray's hit would have been the hit
        came = np.ascontiguousarray(self._motion.boxes[1::2])
        crossing(cast.origins, cast.directions, np.where(hit, cast.hits.t, FAR), came, uncertain)


class Reprojection:
    """The present hits, moved with their objects and drawn into their hemispheres. Needs `motion.same_topology`.

    footprints: a hit covers its cell by footprints² points on its tangent plane; 1: the hit alone, as published.
    """

    def __init__(self, motion: Motion, sampler: TemporalSampler, incoming: Incoming, grid: Grid, footprints: int) -> None:
        if not motion.same_topology:
            raise ValueError("hits can only be followed where the triangles of both frames correspond")
        self._motion, self._sampler, self._incoming = motion, sampler, incoming
        self._grid, self._footprints = grid, footprints

    def __call__(self, cast: Cast) -> tuple[F32, F32, int]:
        """See `sampling.Ahead`."""
        seen = cast.seen
        triangle = cast.hits.triangle[seen.ray]
        moves = self._motion.moved[triangle]
        position, directions = seen.position.copy(), cast.directions.copy()
        rays = seen.ray[moves]
        position[moves] = _points(self._motion.after, cast.hits, rays)
        towards = position[moves] - cast.origins[rays]
        directions[rays] = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
        changed = np.zeros(len(cast.hits.t), bool)
        changed[rays] = True
        shaded = shaded_later(self._motion, self._incoming, self._sampler, cast, cast.hits, directions, changed)
        if not moves.any():
            return shaded.radiance, shaded.nearness, shaded.rays
        moved = Moved(seen.ray, seen.position, position, seen.geometric, moves)
        radiance, nearness = reprojected(cast, moved, shaded.radiance, self._grid, self._footprints)
        return radiance, nearness, shaded.rays


def shaded_later(
    motion: Motion, incoming: Incoming, sampler: TemporalSampler, cast: Cast, hits: Hits, directions: F32, changed: Mask
) -> Shaded:
    """Light of hits in the next frame's World along unit directions (R, 3). changed (R,): rays whose hit isn't that of `cast`.

    incoming: of the next frame. What is lit as before keeps the radiance of `cast`, to the bit.
    """
    seen = seen_along(motion.after, directions, hits)
    relit = changed[seen.ray]
    _relight(motion, seen, relit)
    rows = np.flatnonzero(relit)
    columns: Any = (column[rows] for column in seen)
    part = Seen(*columns)
    radiance, nearness = cast.radiance.copy(), cast.nearness.copy()
    radiance[changed], nearness[changed] = 0, 0
    rays = 0
    if len(rows):
        radiance[part.ray], rays = incoming(part, sampler.light_numbers(part, cast.random))
    again = seen.ray[changed[seen.ray]]
    nearness[again] = 1 / np.maximum(hits.t[again], OFFSET)
    return Shaded(radiance, nearness, rays)


def _relight(motion: Motion, seen: Seen, relit: Mask) -> None:
    """relit (S,) |= whether the light of a hit may change: where lights changed, or something moves between it and a light."""
    world = motion.after
    stochastic = len(world.emissive) > 0 or (world.environment is not None and any(world.environment.radiance))
    if motion.lights or motion.materials or not motion.same_topology or (stochastic and len(motion.boxes)):
        relit[:] = True
        return
    for light in world.lights:
        if light.kind == "directional":
            direction = np.broadcast_to(-light.direction, seen.position.shape)
            crossing(seen.position, direction, np.full(len(relit), FAR), motion.boxes, relit)
        else:
            crossing(seen.position, light.position - seen.position, np.ones(len(relit)), motion.boxes, relit)


def _points(world: World, hits: Hits, rays: NDArray[np.int64]) -> NDArray[np.float64]:
    """Where hits lie in another World with the same triangles, float64 (R, 3)."""
    u, v = hits.u[rays].astype(np.float64)[:, None], hits.v[rays].astype(np.float64)[:, None]
    a, b, c = (world.positions[column].astype(np.float64) for column in world.triangles[hits.triangle[rays]].T)
    return np.asarray((1 - u - v) * a + u * b + v * c)
