"""Hemispheres one frame ahead.

raycast    the hemisphere of the next frame itself, by `updating` the present one. A hemisphere on a surface that moves goes with
           it: at its old place there will be the inside of an object, or nothing.
reproject  hits move with their objects and are drawn into the same hemisphere (Gautron 2006, 5.4.2): only shadow rays
           are cast. A hemisphere that goes with its surface sees all else move the other way. `plane_sampling` does so on planes.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.records import Sites
from renderers.transport.raycast import Hits, caster_of
from renderers.transport.seen import Seen
from renderers.transport.temporal.anchors import departing, departures
from renderers.transport.temporal.motion import Motion
from renderers.transport.temporal.reprojection import Moved, reprojected
from renderers.transport.temporal.sampling import Cast, TemporalSampler
from renderers.transport.temporal.updating import KEPT, SHADED, Differences, Found, states_of, update

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]
NONE = np.zeros(0, np.int64)


class RayCast:
    """The next frame's hemispheres, exactly. sampler: any with the grid of the casts."""

    def __init__(self, motion: Motion, sampler: TemporalSampler, incoming: Incoming) -> None:
        self._motion, self._sampler, self._incoming = motion, sampler, incoming
        self._differences = Differences.of(motion)
        self.smooth = motion.lights
        caster_of(motion.after)  # built here, not in the threads

    def __call__(self, cast: Cast) -> tuple[Found, int]:
        """See `sampling.Ahead`."""
        origins, directions, going = rays_later(cast, *departures(self._motion, cast.sites))
        places, rays, found = len(cast.tangents), (origins, directions), cast.found.copy()
        known = going if self._motion.same_topology else np.ones(len(going), bool)
        states = states_of(self._differences, rays, found.hits, known)
        numbers = partial(self._sampler.light_numbers, cast=cast)
        return found, update(self._motion.after, self._incoming, rays, places, states, found, numbers)

    def changes(self, sites: Sites) -> Mask:
        """See `sampling.Ahead`."""
        if self._differences.everywhere:
            return np.ones(len(sites.position), bool)
        out = np.zeros(len(sites.position), bool)
        out[departing(self._motion, sites)[0]] = True
        return out


def rays_later(cast: Cast, index: I64, rotation: F64, shift: F64) -> tuple[F32, F32, Mask]:
    """Origins and directions (R, 3) one frame later, where some places go as `departures` says, and which rays do, (R,)."""
    rays = np.zeros(len(cast.origins), bool)
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
    """Hits (S,) of a cast one frame later. seen: now; position float64 (S, 3): where they are then as their places see them, turned
    and shifted back with those that go; moves bool (S,): whether they do by that view; found: light of all rays, as they were cast;
    rays: number of those cast."""

    seen: Seen
    position: F64
    moves: Mask
    found: Found
    rays: int


def followed(motion: Motion, sampler: TemporalSampler, incoming: Incoming, cast: Cast, follows: bool) -> Followed:
    """Hits moved with their objects, in the light of the next frame. follows: places on surfaces that move go with them."""
    seen, places, found = cast.seen, cast.sites.position, cast.found.copy()
    assert seen is not None
    index, rotation, shift = departures(motion, cast.sites) if follows else (NONE, np.zeros((0, 3, 3)), np.zeros((0, 3)))
    origins, directions, going = rays_later(cast, index, rotation, shift)
    moved = motion.moved[found.hits.triangle[seen.ray]]
    moves, position = moved | going[seen.ray], seen.position.copy()
    position[moved] = _points(motion.after, found.hits, seen.ray[moved])
    rays, directions = seen.ray[moves], directions.copy()
    towards = position[moves] - origins[rays]
    directions[rays] = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    none, as_cast = np.zeros(len(going), bool), (cast.origins, cast.directions)
    states = states_of(Differences.of(motion), as_cast, found.hits, none)
    states[states > KEPT] = SHADED  # nothing is cast anew but shadow rays
    spent = update(
        motion.after, incoming, (origins, directions), len(places), states, found, partial(sampler.light_numbers, cast=cast)
    )
    if len(index):
        number = np.zeros(len(places), np.int64)
        number[index] = np.arange(len(index))
        gone = np.flatnonzero(going[seen.ray])
        place = seen.ray[gone] // (len(cast.origins) // len(places))
        k, centre = number[place], places[place]
        position[gone] = np.einsum("nji,nj->ni", rotation[k], position[gone] - centre - shift[k]) + centre
    return Followed(seen, position, moves, found, spent)


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

    def __call__(self, cast: Cast) -> tuple[Found, int]:
        """See `sampling.Ahead`."""
        then = followed(self._motion, self._sampler, self._incoming, cast, self._follows)
        if not then.moves.any():
            return then.found, then.rays
        seen, sampler = then.seen, self._sampler
        moved = Moved(seen.ray, seen.position, then.position, seen.geometric, then.moves)
        solid = sampler.equal_solid_angle
        radiance, nearness = reprojected(cast, moved, then.found.radiance, sampler.grid, self._footprints, solid)
        return then.found._replace(radiance=radiance, nearness=nearness), then.rays


def _points(world: World, hits: Hits, rays: NDArray[np.int64]) -> NDArray[np.float64]:
    """Where hits lie in another World with the same triangles, float64 (R, 3)."""
    u, v = hits.u[rays].astype(np.float64)[:, None], hits.v[rays].astype(np.float64)[:, None]
    a, b, c = (world.positions[column].astype(np.float64) for column in world.triangles[hits.triangle[rays]].T)
    return np.asarray((1 - u - v) * a + u * b + v * c)
