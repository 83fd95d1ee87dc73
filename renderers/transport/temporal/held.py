"""Hemispheres kept from one renewal of a record to the next, so that it costs what changed since.

A place has the same rays all its life. Of what they found when it was last computed, or was foreseen exactly for the frame after
that, most still holds when it is renewed: `updating` finds out which. What comes out is what casting all rays anew would give, but
for the rounding of rays cast in other company.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.records import Sites
from renderers.transport.raycast import OFFSET, Hits
from renderers.transport.temporal.motion import Changes
from renderers.transport.temporal.updating import Differences, Found

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Kept(NamedTuple):
    """What the rays of one place found in a frame. pose float64 (5, 3): position, normal and geometric normal of the place, and the
    axes of its hemisphere; hits: of its C rays; radiance float32 (C, 3)."""

    frame: int
    pose: F64
    hits: Hits
    radiance: F32

    @property
    def bytes(self) -> int:
        """Memory it takes."""
        return sum(column.nbytes for column in (*self.hits, self.radiance))


def poses(sites: Sites, tangents: F64) -> F64:
    """What the rays of K places depend on, (K, 5, 3)."""
    return np.concatenate([np.stack(sites, axis=1), tangents], axis=1)


class Held:
    """Hemispheres of live places. most: bytes that they may take; places that come when these are taken aren't held."""

    def __init__(self, most: int) -> None:
        self.frame = 0
        self._most, self._taken = most, 0
        self._kept: dict[int, Kept] = {}
        self._since: dict[int, Changes] = {}
        self._group: dict[int, int] = {}
        self._differences: Differences | None = None

    def advance(self, frame: int, world: World, changes: Changes | None) -> None:
        """Go on to a frame. changes: since the frame before; None, or those of another topology: nothing held is of any use."""
        self.frame = frame
        if changes is None or not changes.same_topology:
            self.keep(np.zeros(0, np.int64))
            self._since.clear()
        else:
            self._since = {since: before.then(changes) for since, before in self._since.items()}
        self._since[frame] = Changes.none(len(world.triangles))
        self._differences = None

    def keep(self, places: I64) -> None:
        """Drop all but these places (N,)."""
        alive = set(places.tolist())
        for place in self._kept.keys() - alive:
            self._taken -= self._kept.pop(place).bytes
        used = {kept.frame for kept in self._kept.values()}
        newest = max(self._since, default=0)
        self._since = {since: changes for since, changes in self._since.items() if since in used or since == newest}
        self._differences = None

    def holds(self, places: I64, sites: Sites, tangents: F64) -> NDArray[np.bool_]:
        """Which of K places (numbers, (K,)) are held just as they are, (K,)."""
        out = np.zeros(len(places), bool)
        for k, (place, pose) in enumerate(zip(places.tolist(), poses(sites, tangents), strict=True)):
            out[k] = place in self._kept and np.array_equal(self._kept[place].pose, pose)
        return out

    def found(self, places: I64) -> Found:
        """What the rays of places, all held, found; free to be written to."""
        parts = [self._kept[place] for place in places.tolist()]
        columns: Any = (np.concatenate(column) for column in zip(*(part.hits for part in parts), strict=True))
        hits = Hits(*columns)
        nearness = np.where(hits.triangle >= 0, 1 / np.maximum(hits.t, OFFSET), np.float32(0))
        return Found(hits, np.concatenate([part.radiance for part in parts]), nearness)

    def differences(self, world: World) -> Differences:
        """What changed since each of the frames that hemispheres are held of, until the present one, whose World is given."""
        if self._differences is None:
            self._group = {since: g for g, since in enumerate(sorted(self._since))}
            self._differences = Differences.of([self._since[since] for since in sorted(self._since)], world)
        return self._differences

    def group(self, places: I64) -> I64:
        """Which of `differences` is each held place's, (K,)."""
        return np.array([self._group[self._kept[place].frame] for place in places.tolist()], np.int64)

    def store(self, frame: int, places: Sequence[int], pose: F64, found: Found) -> None:
        """Hold what the rays of K places found, or were foreseen to find, in a frame. pose (K, 5, 3): see `poses`."""
        cells = len(found.nearness) // len(places)
        for k, place in enumerate(places):
            rays = slice(k * cells, (k + 1) * cells)
            columns: Any = (column[rays].copy() for column in found.hits)
            kept = Kept(frame, pose[k], Hits(*columns), found.radiance[rays].copy())
            before = self._kept.pop(place, None)
            self._taken -= 0 if before is None else before.bytes
            if self._taken + kept.bytes <= self._most:
                self._kept[place] = kept
                self._taken += kept.bytes
