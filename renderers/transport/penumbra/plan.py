"""How construction divides its memory: rows of the pyramid at a time, shadow maps at a time, and room for events.

A slab of rows touches a band of each shadow map only: the rows that its rays cross between near and far plane. At a time there live

    bands of `batch` maps, and three more for each of `part` that are being drawn
    for each thread, room for `events` events: as found (9 bytes), sorted (4), and the vertices made of them (8)
    where `batch` is not all: the events of the whole slab until its last batch, in room for `kept` of them

Each of these is made once, as large as planned, and used again by every slab and batch. The plan is the one with the largest slabs
whose sum is within the bound; with all maps at a time where the bound allows it, because tiles of rows then are finished at once,
and no map is drawn twice if one slab is all. What has more events than there is room for is done again in halves, down to a pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.cameras import DV, V0, S
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.room import VERTEX
from renderers.transport.penumbra.walk import BLOCK
from renderers.transport.threads import thread_count

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
# rows that are walked together: they read almost the same texels
TILE = 8
FOUND, SORTED = 9, 4
# events a ray and map that room is made for: scenes have .3 to 1.2, more is found in smaller tiles
DENSITY = 1.5
# those that a slab which keeps its events is made for: with more it is done again in halves
KEPT = 0.75
# the least number of events that a slab keeps room for
FEW = 4096
# texels of a step of the walks beyond a ray's own, and of rounding
MARGIN = 2
PART = 16


class Plan(NamedTuple):
    """slabs: rows of the pyramid at a time. batch: shadow maps at a time, part: being drawn at a time; rows: of their longest band.
    tile: rows that a thread walks, events: that it has room for. kept: events that a slab may keep between batches. bytes: of all
    of it together.
    """

    slabs: list[range]
    batch: int
    part: int
    rows: int
    tile: int
    events: int
    kept: int
    bytes: int


class _Planner:
    """Sizes of one construction's parts. texel: bytes of a texel of a finished map."""

    def __init__(self, pyramid: Pyramid, rows: range, cameras: F64, shape: tuple[int, int], *, blocks: bool) -> None:
        self.pyramid, self.rows, self.cameras, self.shape = pyramid, rows, cameras, shape
        self.texel = 4 * (1 + 2 / BLOCK**2) if blocks else 4.0
        self.threads, self.count = thread_count(), len(cameras)
        # events of a row of the pyramid in all maps
        self.row = DENSITY * pyramid.width * self.count
        # what one ray, or one step of a row of them, may find in one map
        self.least = 4 * (pyramid.width + shape[0] + shape[1] + BLOCK)
        self._bands: dict[range, int] = {}

    def longest(self, slabs: list[range]) -> int:
        """Rows of the longest band."""
        for slab in slabs:
            if slab not in self._bands:
                self._bands[slab] = band_of(self.pyramid, self.cameras, slab, self.shape[0])[1]
        return max(self._bands[slab] for slab in slabs)

    def maps(self, slabs: list[range], batch: int, part: int) -> int:
        """Bytes of bands."""
        return int((batch * self.texel + part * 12) * self.longest(slabs) * self.shape[1])

    def working(self, events: int) -> int:
        """Bytes of the threads' rooms."""
        return self.threads * events * (FOUND + SORTED + VERTEX)

    def plan(self, slabs: list[range], batch: int, part: int, events: int, kept: int) -> Plan:
        """The plan of these sizes."""
        tile = int(np.clip(events / self.row, 1, TILE))
        size = self.working(events) + self.maps(slabs, batch, part) + kept * FOUND
        return Plan(slabs, batch, part, self.longest(slabs), tile, events, kept, size)

    def candidates(self, memory: int) -> Iterator[Plan]:
        """Plans, better ones first; not all of them are within `memory`."""
        wanted = int(np.clip(memory // 5 // self.working(1), self.least, TILE * self.row + 4096))
        for events in (wanted, self.least):
            left = memory - self.working(events)
            size = self.shape[0] * self.shape[1] * 12
            for part in (min(PART, self.count, max(self.threads, left // 16 // size)), 1):
                batches = self._batches(left, part, events)
                tile = int(np.clip(events / self.row, 1, TILE))
                for slabs in _divisions(self.rows, min(len(self.rows), tile)):
                    # every slab draws a band of every map: fewer slabs are less work, however they are finished
                    if batches is not None and len(slabs) > len(batches.slabs):
                        break
                    yield self.plan(slabs, self.count, part, events, 0)
                if batches is not None:
                    yield batches
        yield self.plan(_slabs(self.rows, 1), 1, 1, self.least, FEW)

    def _batches(self, left: int, part: int, events: int) -> Plan | None:
        """The plan with the largest slabs that keeps events between batches: in up to half of `left` bytes, maps in the rest."""
        row = KEPT * self.pyramid.width * self.count
        most = min(int(left / 2 // (FOUND * row)), len(self.rows))
        while most >= 1:
            slabs = _slabs(self.rows, most)
            kept = min(left // 2 // FOUND, int(row * most))
            one, two = (self.maps(slabs, n, part) for n in (1, 2))
            batch = 1 + (left - kept * FOUND - one) // (two - one + 1)
            if batch >= 1:
                return self.plan(slabs, min(batch, self.count), part, events, kept)
            most //= 2
        return None


def plan_of(pyramid: Pyramid, rows: range, cameras: F64, shape: tuple[int, int], memory: int, *, blocks: bool) -> Plan:
    """The plan for some rows of a pyramid from maps of `shape` (rows, columns) within `memory` bytes; the smallest one, beyond it,
    where there is none. blocks: maps are kept with the bounds of their blocks.
    """
    found = None
    for found in _Planner(pyramid, rows, cameras, shape, blocks=blocks).candidates(memory):
        if found.bytes <= memory:
            break
    assert found is not None
    return found


def band_of(pyramid: Pyramid, cameras: F64, rows: range, height: int) -> tuple[I64, int]:
    """Which rows of the maps (of `height` rows) the rays of some rows of the pyramid cross: the first of each map's (N,), whole
    blocks, and how many, alike for all: a band may end beyond its map.

    A slab's rays fill a frustum, and its picture in a camera is the hull of its corners': all are before the camera.
    """
    u = pyramid.low[0] + np.array([0, pyramid.width]) * pyramid.pitch
    v = pyramid.low[1] + np.array([rows.start, rows.stop]) * pyramid.pitch
    corners = np.array([[a * z, b * z, z] for z in (pyramid.near, pyramid.far) for a in u for b in v])
    seen = np.einsum("nij,nkj->nki", cameras[:, :9].reshape(-1, 3, 3), corners[None] - cameras[:, None, S : S + 3])
    y = (seen[..., 1] / seen[..., 2] - cameras[:, [V0]]) / cameras[:, [DV]]
    first = np.clip(np.floor(y.min(axis=1)).astype(np.int64) - MARGIN, 0, height) // BLOCK * BLOCK
    last = np.clip(np.ceil(y.max(axis=1)).astype(np.int64) + MARGIN, 0, height)
    return first, max(int((last - first).max()), 1)


def _divisions(rows: range, least: int) -> list[list[range]]:
    """Slabs from one of all rows down to those of `least` rows."""
    sizes = sorted({-(-len(rows) // k) for k in range(1, len(rows) // least + 1)}, reverse=True)
    return [_slabs(rows, size) for size in sizes]


def _slabs(rows: range, size: int) -> list[range]:
    return [rows[start : start + size] for start in range(0, len(rows), size)]
