"""Hemispheres one frame ahead.

raycast    the hemisphere of the next frame itself. Rays are cast anew only where they may end elsewhere: those that hit something
           that moves, and those that touch the bounding box of something that moved. What they hit is shaded anew only where its
           light may have changed: by a light, or by what moves across the way to a light. The rest is that of the present frame, so
           the price follows what moves, not the scene. A hemisphere on a surface that moves goes with it: at its old place there
           will be the inside of an object, or nothing.
reproject  hits move with their objects and are drawn into the same hemisphere (Gautron 2006, 5.4.2): only shadow rays
           are cast. A hemisphere that goes with its surface sees all else move the other way. `plane_sampling` does so on planes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.records import Sites
from renderers.transport.raycast import FAR, OFFSET, Hits, caster_of
from renderers.transport.seen import Seen, seen_along
from renderers.transport.temporal.anchors import departing, departures
from renderers.transport.temporal.motion import Motion, crossing
from renderers.transport.temporal.reprojection import Moved, reprojected
from renderers.transport.temporal.sampling import Cast, TemporalSampler

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]
NONE = np.zeros(0, np.int64)
MANY = 16  # boxes: beyond, casting a ray at what moves is cheaper than testing it against them


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
        self.smooth = motion.lights

    def __call__(self, cast: Cast) -> tuple[F32, F32, int]:
        """See `sampling.Ahead`."""
        columns: Any = (column.copy() for column in cast.hits)
        hits = Hits(*columns)
        origins, directions, changed = rays_later(cast, *departures(self._motion, cast.sites))
        anew, rays = self._recast(origins, directions, hits, changed), 0
        if len(anew):
            found = self._caster.first_hit(origins[anew], directions[anew])
            _replaced(hits, anew, found)
            rays = len(anew)
        shaded = shaded_later(self._motion, self._incoming, self._sampler, cast, hits, directions, changed)
        return shaded.radiance, shaded.nearness, rays + shaded.rays

    def changes(self, sites: Sites) -> Mask:
        """See `sampling.Ahead`."""
        if _relights_all(self._motion) or len(self._motion.boxes) > MANY:
            return np.ones(len(sites.position), bool)
        out = np.zeros(len(sites.position), bool)
        out[departing(self._motion, sites)[0]] = True
        return out

    def _recast(self, origins: F32, directions: F32, hits: Hits, changed: Mask) -> NDArray[np.int64]:
        """Rays that may hit something else, or elsewhere; changed (R,), those known to differ, is updated, and hits as well."""
        motion = self._motion
        if not motion.same_topology:
            changed[:] = True
            return np.arange(len(changed))
        hit = hits.triangle >= 0
        changed[hit] |= motion.moved[hits.triangle[hit]]
        if len(motion.boxes) <= MANY:
            # what moved away from before a ray's hit would have been the hit
            came = np.ascontiguousarray(motion.boxes[1::2])
            crossing(origins, directions, np.where(hit, hits.t, FAR), came, changed)
            return np.flatnonzero(changed)
        rest = np.flatnonzero(~changed)
        found = self._caster.first_moving_hit(origins[rest], directions[rest])
        if found is None:
            changed[:] = True
            return np.arange(len(changed))
        nearer = (found.triangle >= 0) & (~hit[rest] | (found.t < hits.t[rest]))
        anew = np.flatnonzero(changed)
        columns: Any = (column[nearer] for column in found)
        _replaced(hits, rest[nearer], Hits(*columns))
        changed[rest[nearer]] = True
        return anew


def _replaced(hits: Hits, index: NDArray[np.int64], others: Hits) -> None:
    for column, value in zip(hits, others, strict=True):
        column[index] = value


def rays_later(cast: Cast, index: I64, rotation: F64, shift: F64) -> tuple[F32, F32, Mask]:
    """Origins and directions (R, 3) one frame later, where some places go as `departures` says, and which rays do, (R,)."""
    rays = np.zeros(len(cast.hits.t), bool)
    if not len(index):
        return cast.origins, cast.directions, rays
    by_place = len(cast.tangents), -1, 3
    origins, directions = (a.reshape(by_place).copy() for a in (cast.origins, cast.directions))
    place = cast.sites.position[index][:, None]
    origins[index] = np.einsum("kij,krj->kri", rotation, origins[index] - place) + place + shift[:, None]
    directions[index] = np.einsum("kij,krj->kri", rotation, directions[index])
    rays.reshape(len(cast.tangents), -1)[index] = True
    return origins.reshape(-1, 3), directions.reshape(-1, 3), rays


class Followed(NamedTuple):
    """Hits (S,) of a cast one frame later. position float64 (S, 3): where they are then as their places see them, turned and
    shifted back with those that go; moves bool (S,): whether they do by that view; shaded: light of all rays, as they were cast."""

    position: F64
    moves: Mask
    shaded: Shaded


def followed(motion: Motion, sampler: TemporalSampler, incoming: Incoming, cast: Cast, follows: bool) -> Followed:
    """Hits moved with their objects, in the light of the next frame. follows: places on surfaces that move go with them."""
    seen, places = cast.seen, cast.sites.position
    index, rotation, shift = departures(motion, cast.sites) if follows else (NONE, np.zeros((0, 3, 3)), np.zeros((0, 3)))
    origins, directions, going = rays_later(cast, index, rotation, shift)
    moved = motion.moved[cast.hits.triangle[seen.ray]]
    moves, position = moved | going[seen.ray], seen.position.copy()
    position[moved] = _points(motion.after, cast.hits, seen.ray[moved])
    rays, directions = seen.ray[moves], directions.copy()
    towards = position[moves] - origins[rays]
    directions[rays] = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    changed = np.zeros(len(cast.hits.t), bool)
    changed[seen.ray[moved]] = True
    shaded = shaded_later(motion, incoming, sampler, cast, cast.hits, directions, changed)
    if len(index):
        number = np.zeros(len(places), np.int64)
        number[index] = np.arange(len(index))
        gone = np.flatnonzero(going[seen.ray])
        place = seen.ray[gone] // (len(cast.origins) // len(places))
        k, centre = number[place], places[place]
        position[gone] = np.einsum("nji,nj->ni", rotation[k], position[gone] - centre - shift[k]) + centre
    return Followed(position, moves, shaded)


class Reprojection:
    """The present hits, moved with their objects and drawn into their hemispheres. Needs `motion.same_topology`.

    footprints: a hit covers its cell by footprints² points on its tangent plane; 1: the hit alone, as published. follows: places on
    surfaces that move go with them.
    """

    smooth = True

    def __init__(
        self, motion: Motion, sampler: TemporalSampler, incoming: Incoming, footprints: int = 1, follows: bool = True
    ) -> None:
        if not motion.same_topology:
            raise ValueError("hits can only be followed where the triangles of both frames correspond")
        self._motion, self._sampler, self._incoming = motion, sampler, incoming
        self._footprints, self._follows = footprints, follows

    def changes(self, sites: Sites) -> Mask:
        """See `sampling.Ahead`: drawing hits costs much less than casting rays."""
        return np.zeros(len(sites.position), bool)

    def __call__(self, cast: Cast) -> tuple[F32, F32, int]:
        """See `sampling.Ahead`."""
        then = followed(self._motion, self._sampler, self._incoming, cast, self._follows)
        shaded = then.shaded
        if not then.moves.any():
            return shaded.radiance, shaded.nearness, shaded.rays
        seen, sampler = cast.seen, self._sampler
        moved = Moved(seen.ray, seen.position, then.position, seen.geometric, then.moves)
        solid = sampler.equal_solid_angle
        radiance, nearness = reprojected(cast, moved, shaded.radiance, sampler.grid, self._footprints, solid)
        return radiance, nearness, shaded.rays


def shaded_later(
    motion: Motion, incoming: Incoming, sampler: TemporalSampler, cast: Cast, hits: Hits, directions: F32, changed: Mask
) -> Shaded:
    """Light of hits in the next frame's World along unit directions (R, 3). changed (R,): rays whose hit isn't that of `cast`.

    incoming: of the next frame. What is lit as before keeps the radiance of `cast`, to the bit.
    """
    radiance, nearness, rays = cast.radiance.copy(), cast.nearness.copy(), 0
    radiance[changed], nearness[changed] = 0, 0
    # a new albedo may be anywhere
    index = np.arange(len(changed)) if motion.materials else np.flatnonzero(changed)
    anew = seen_along(motion.after, directions[index], Hits._make(column[index] for column in hits))
    anew = anew._replace(ray=index[anew.ray])
    nearness[anew.ray] = 1 / np.maximum(hits.t[anew.ray], OFFSET)
    kept = np.flatnonzero(~changed[cast.seen.ray]) if not motion.materials else index[:0]
    kept = kept[_relit(motion, cast.seen.position[kept])]
    part = anew
    if len(kept):
        pairs: Any = zip(anew, (column[kept] for column in cast.seen), strict=True)
        part = Seen(*map(np.concatenate, pairs))
    if len(part.ray):
        radiance[part.ray], rays = incoming(part, sampler.light_numbers(part, cast))
    return Shaded(radiance, nearness, rays)


def _relights_all(motion: Motion) -> bool:
    """Whether the light of any surface may change."""
    world = motion.after
    stochastic = len(world.emissive) > 0 or (world.environment is not None and any(world.environment.radiance))
    return motion.lights or motion.materials or not motion.same_topology or (stochastic and len(motion.boxes) > 0)


def _relit(motion: Motion, position: NDArray[np.float64]) -> Mask:
    """Whether the light of hits at rest (S, 3) may change, (S,): lights changed, or something moves between it and a light."""
    out = np.zeros(len(position), bool)
    if _relights_all(motion) or len(motion.boxes) > MANY:
        out[:] = True
        return out
    for light in motion.after.lights:
        if light.kind == "directional":
            crossing(position, np.broadcast_to(-light.direction, position.shape), np.full(len(out), FAR), motion.boxes, out)
        else:
            crossing(position, light.position - position, np.ones(len(out)), motion.boxes, out)
    return out


def _points(world: World, hits: Hits, rays: NDArray[np.int64]) -> NDArray[np.float64]:
    """Where hits lie in another World with the same triangles, float64 (R, 3)."""
    u, v = hits.u[rays].astype(np.float64)[:, None], hits.v[rays].astype(np.float64)[:, None]
    a, b, c = (world.positions[column].astype(np.float64) for column in world.triangles[hits.triangle[rays]].T)
    return np.asarray((1 - u - v) * a + u * b + v * c)
