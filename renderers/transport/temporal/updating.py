"""What rays found, brought from one frame to another: only those are cast anew that may end elsewhere, and only what they hit is
shaded anew whose light may have changed.

Cast anew are rays that hit something that moves, and those that touch the bounding box of something that moved. Shaded anew is
what they hit then, and where something moved across the way to a light; everything, where lights changed, or are sampled at random
and something moved. The rest keeps its bits, so the price follows what moves, not the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.incoming import Incoming
from renderers.transport.raycast import FAR, OFFSET, Hits, caster_of
from renderers.transport.seen import Seen, seen_along
from renderers.transport.temporal.motion import Changes

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
States = NDArray[np.uint8]
MANY = 16  # boxes: beyond, casting a ray at what moves is cheaper than testing it against them
PACKET = 16  # rays that are cast together
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
    """What changed between each of G frames and a later one, the same for all, as the kernel reads it.

    moved bool (G, T); boxes float32 (B, 2, 3), those of frame g from first[g] on, first int64 (G + 1,); everywhere bool (G,): light
    may have changed anywhere; crowded bool (G,): more than MANY boxes. lamps float64 (L, 3): positions, or directions towards
    those, that are far bool (L,).
    """

    moved: NDArray[np.bool_]
    boxes: F32
    first: I64
    everywhere: NDArray[np.bool_]
    crowded: NDArray[np.bool_]
    lamps: F64
    far: NDArray[np.bool_]

    @staticmethod
    def of(changes: Sequence[Changes], after: World) -> Differences:
        """Of one frame at least, whose triangles are those of the World `after`."""
        counts = np.array([len(each.boxes) for each in changes])
        crowded = counts > MANY
        everywhere = crowded | [relights_all(each, after) for each in changes]
        far = np.array([light.kind == "directional" for light in after.lights], bool)
        lamps = [-light.direction if light.kind == "directional" else light.position for light in after.lights]
        return Differences(
            np.stack([each.moved for each in changes]), np.concatenate([each.boxes for each in changes]),
            np.concatenate([[0], np.cumsum(counts)]), everywhere, crowded, np.array(lamps, np.float64).reshape(-1, 3), far,
        )  # fmt: skip


def relights_all(changes: Changes, after: World) -> bool:
    """Whether the light of any surface may change."""
    stochastic = len(after.emissive) > 0 or (after.environment is not None and any(after.environment.radiance))
    moves = stochastic and len(changes.boxes) > 0
    return changes.lights or changes.materials or not changes.same_topology or moves


def states_of(differences: Differences, group: I64, rays: tuple[F32, F32], hits: Hits, known: NDArray[np.bool_]) -> States:
    """KEPT, ASKED, SHADED or CAST for each of R rays (origins, directions), which belong to K places in turn.

    group (K,): frame that each place's hits are of; known (R,): rays to be cast in any case.
    """
    states = known.astype(np.uint8) * np.uint8(CAST)
    _states(differences, group, *rays, hits.triangle, hits.t, states)
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
    out, count = np.empty(len(states) + PACKET * (len(states) // cells), np.int64), 0
    for start in range(0, len(states), cells):
        first = count
        for ray in range(start, start + cells):
            if states[ray] == CAST:
                out[count] = ray
                count += 1
        while (count - first) % PACKET:
            out[count] = out[count - 1]
            count += 1
    return out[:count]


@numba.njit(nogil=True, cache=True)
def _states(differences, group, origins, directions, triangle, t, states):  # type: ignore[no-untyped-def]
    """See `states_of`. Hits are taken to lie at origin + t · direction: boxes have a margin."""
    moved, boxes, first, everywhere, crowded, lamps, far = differences
    cells = len(states) // len(group)
    for place in range(len(group)):
        g = group[place]
        start, stop = first[g], first[g + 1]
        for ray in range(place * cells, (place + 1) * cells):
            if states[ray] == CAST:
                continue
            hit = triangle[ray] >= 0
            if hit and moved[g, triangle[ray]]:
                states[ray] = CAST
                continue
            if crowded[g]:
                states[ray] = ASKED
                continue
            if stop > start:
                o = origins[ray, 0], origins[ray, 1], origins[ray, 2]
                d = directions[ray, 0], directions[ray, 1], directions[ray, 2]
                # what moved away from before a hit would have been the hit
                if touches(o, d, t[ray] if hit else FAR, boxes, start + 1, stop, 2):
                    states[ray] = CAST
                    continue
            if not hit:
                continue
            if everywhere[g]:
                states[ray] = SHADED
            elif stop > start:
                p = o[0] + t[ray] * d[0], o[1] + t[ray] * d[1], o[2] + t[ray] * d[2]
                for lamp in range(len(lamps)):
                    own = 0.0 if far[lamp] else 1.0
                    towards = lamps[lamp, 0] - own * p[0], lamps[lamp, 1] - own * p[1], lamps[lamp, 2] - own * p[2]
                    if touches(p, towards, FAR if far[lamp] else 1.0, boxes, start, stop, 1):
                        states[ray] = SHADED
                        break


@numba.njit(nogil=True, cache=True, error_model="numpy")
def touches(origin, direction, reach, boxes, start, stop, step):  # type: ignore[no-untyped-def]
    """Whether origin + s·direction, 0 ≤ s ≤ reach, touches one of the boxes (B, 2, 3) start, start + step, … below stop.

    Slabs; along an axis that the direction doesn't follow it is taken to creep by 10⁻³⁰ of its length.
    """
    x = 1 / (np.float64(direction[0]) if direction[0] != 0 else CREEP)
    y = 1 / (np.float64(direction[1]) if direction[1] != 0 else CREEP)
    z = 1 / (np.float64(direction[2]) if direction[2] != 0 else CREEP)
    for b in range(start, stop, step):
        one, other = (boxes[b, 0, 0] - origin[0]) * x, (boxes[b, 1, 0] - origin[0]) * x
        near, far = max(0.0, min(one, other)), min(np.float64(reach), max(one, other))
        one, other = (boxes[b, 0, 1] - origin[1]) * y, (boxes[b, 1, 1] - origin[1]) * y
        near, far = max(near, min(one, other)), min(far, max(one, other))
        one, other = (boxes[b, 0, 2] - origin[2]) * z, (boxes[b, 1, 2] - origin[2]) * z
        near, far = max(near, min(one, other)), min(far, max(one, other))
        if near <= far:
            return True
    return False
