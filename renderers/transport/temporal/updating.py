"""What rays found, brought to the next frame: only those are cast anew that may end elsewhere, and only what they hit is
shaded anew whose light may have changed.

Cast anew are rays that hit something that moves, and those that touch the bounding box of something that moved. Shaded anew is
what they hit then, and where something moved across the way to a light; everything, where lights changed, or are sampled at random
and something moved. The rest keeps its bits, so the price follows what moves, not the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.incoming import Incoming
from renderers.transport.embree import WIDTH
from renderers.transport.raycast import FAR, OFFSET, Hits, caster_of
from renderers.transport.seen import Seen, seen_along
from renderers.transport.temporal.motion import Motion

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
States = NDArray[np.uint8]
MANY = 16  # boxes: beyond, casting a ray at what moves is cheaper than testing it against them
CREEP = 1e-30
KEPT, ASKED, SHADED, CAST = range(4)  # a ray that isn't touched; cast at what moves alone; whose hit is shaded anew; cast anew


class Found(NamedTuple):
    """What R rays found: hits; radiance float32 (R, 3); nearness float32 (R,): 1/t, 0 where nothing was hit."""

    hits: Hits
    radiance: F32
    nearness: F32

    def copy(self) -> Found:
        """One that may be written to."""
        columns: Any = (column.copy() for column in self.hits)
        return Found(Hits(*columns), self.radiance.copy(), self.nearness.copy())


class Differences(NamedTuple):
    """What changes from one frame to the next, as the kernel reads it.

    moved bool (T,), boxes float32 (B, 2, 3): of a `Motion`. everywhere: light may change anywhere; crowded: there are more than
    MANY boxes. lamps float64 (L, 3): positions, or directions towards those that are far, bool (L,).
    """

    moved: NDArray[np.bool_]
    boxes: F32
    everywhere: bool
    crowded: bool
    lamps: F64
    far: NDArray[np.bool_]

    @staticmethod
    def of(motion: Motion) -> Differences:
        """Those of a motion."""
        lights, crowded = motion.after.lights, len(motion.boxes) > MANY
        far = np.array([light.kind == "directional" for light in lights], bool)
        lamps = [-light.direction if light.kind == "directional" else light.position for light in lights]
        places = np.array(lamps, np.float64).reshape(-1, 3)
        return Differences(motion.moved, motion.boxes, crowded or _relights_all(motion), crowded, places, far)


def _relights_all(motion: Motion) -> bool:
    """Whether the light of any surface may change."""
    world = motion.after
    stochastic = len(world.emissive) > 0 or (world.environment is not None and any(world.environment.radiance))
    return motion.lights or motion.materials or not motion.same_topology or (stochastic and len(motion.boxes) > 0)


def states_of(differences: Differences, rays: tuple[F32, F32], hits: Hits, known: NDArray[np.bool_]) -> States:
    """KEPT, ASKED, SHADED or CAST for each of R rays (origins, directions). known (R,): those to be cast in any case."""
    states = known.astype(np.uint8) * np.uint8(CAST)
    _states(differences, *rays, hits.triangle, hits.t, states)
    return states


def update(
    world: World, incoming: Incoming, rays: tuple[F32, F32], places: int, states: States, found: Found,
    numbers: Callable[[Seen], F64],
) -> int:  # fmt: skip
    """Bring what the rays of so many places found to the frame of a World, by their states; returns how many rays were cast.

    found: written to. numbers: random numbers (S, 6) for the lights of hits. A place's rays are cast together, and those of no
    other with them: what it finds depends on itself alone.
    """
    origins, directions = rays
    caster, hits = caster_of(world), found.hits
    if not states.any():
        return 0
    asked = np.flatnonzero(states == ASKED)
    if len(asked):
        moving = caster.first_moving_hit(origins[asked], directions[asked])
        states[asked] = CAST if moving is None else SHADED
        if moving is not None:
            own = hits.triangle[asked] < 0
            nearer = np.flatnonzero((moving.triangle >= 0) & (own | (moving.t < hits.t[asked])))
            _replace(hits, asked[nearer], Hits._make(column[nearer] for column in moving))
    cast = _apart(states, len(states) // places)
    if len(cast):
        _replace(hits, cast, caster.first_hit(origins[cast], directions[cast]))
        found.radiance[cast], found.nearness[cast] = 0, 0
    seen = seen_along(world, directions, hits, np.flatnonzero(states >= SHADED))
    if not len(seen.ray):
        return len(cast)
    found.nearness[seen.ray] = 1 / np.maximum(hits.t[seen.ray], OFFSET)
    found.radiance[seen.ray], shadow_rays = incoming(seen, numbers(seen))
    return len(cast) + shadow_rays


def _replace(hits: Hits, index: I64, others: Hits) -> None:
    for column, value in zip(hits, others, strict=True):
        column[index] = value


@numba.njit(nogil=True, cache=True)
def _apart(states, cells):  # type: ignore[no-untyped-def]
    """Rays to be cast, those of each place (`cells` rays) filled up to whole packets by its last."""
    out, count = np.empty(len(states) + WIDTH * (len(states) // cells), np.int64), 0
    for start in range(0, len(states), cells):
        first = count
        for ray in range(start, start + cells):
            if states[ray] == CAST:
                out[count] = ray
                count += 1
        while (count - first) % WIDTH:
            out[count] = out[count - 1]
            count += 1
    return out[:count]


@numba.njit(nogil=True, cache=True)
def _states(differences, origins, directions, triangle, t, states):  # type: ignore[no-untyped-def]
    """See `states_of`. Hits are taken to lie at origin + t · direction: boxes have a margin."""
    moved, boxes, everywhere, crowded, lamps, far = differences
    for ray in range(len(states)):
        if states[ray] == CAST:
            continue
        hit = triangle[ray] >= 0
        if hit and moved[triangle[ray]]:
            states[ray] = CAST
            continue
        if crowded:
            states[ray] = ASKED
            continue
        o = origins[ray, 0], origins[ray, 1], origins[ray, 2]
        d = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        # what moved away from before a hit would have been the hit
        if touches(o, d, t[ray] if hit else FAR, boxes, 1, 2):
            states[ray] = CAST
            continue
        if not hit:
            continue
        if everywhere:
            states[ray] = SHADED
            continue
        p = o[0] + t[ray] * d[0], o[1] + t[ray] * d[1], o[2] + t[ray] * d[2]
        for lamp in range(len(lamps)):
            own = 0.0 if far[lamp] else 1.0
            towards = lamps[lamp, 0] - own * p[0], lamps[lamp, 1] - own * p[1], lamps[lamp, 2] - own * p[2]
            if touches(p, towards, FAR if far[lamp] else 1.0, boxes, 0, 1):
                states[ray] = SHADED
                break


@numba.njit(nogil=True, cache=True, error_model="numpy")
def touches(origin, direction, reach, boxes, start, step):  # type: ignore[no-untyped-def]
    """Whether origin + s·direction, 0 ≤ s ≤ reach, touches one of the boxes (B, 2, 3) start, start + step and so on.

    Slabs; along an axis that the direction doesn't follow it is taken to creep, so that it leaves a box's high face at once.
    """
    x = 1 / (np.float64(direction[0]) if direction[0] != 0 else CREEP)
    y = 1 / (np.float64(direction[1]) if direction[1] != 0 else CREEP)
    z = 1 / (np.float64(direction[2]) if direction[2] != 0 else CREEP)
    for b in range(start, len(boxes), step):
        one, other = (boxes[b, 0, 0] - origin[0]) * x, (boxes[b, 1, 0] - origin[0]) * x
        near, far = max(0.0, min(one, other)), min(np.float64(reach), max(one, other))
        one, other = (boxes[b, 0, 1] - origin[1]) * y, (boxes[b, 1, 1] - origin[1]) * y
        near, far = max(near, min(one, other)), min(far, max(one, other))
        one, other = (boxes[b, 0, 2] - origin[2]) * z, (boxes[b, 1, 2] - origin[2]) * z
        near, far = max(near, min(one, other)), min(far, max(one, other))
        if near <= far:
            return True
    return False
