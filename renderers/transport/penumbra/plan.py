"""How construction divides its memory: rows of the pyramid at a time, shadow maps at a time, and room for events.

A slab of rows touches a band of each shadow map only: the rows that its rays cross between near and far plane. At a time there live

    bands of `batch` maps, and three more for each of `part` that are being drawn
    for each thread, room for `events` events: as found (9 bytes), sorted (4), and the vertices made of them (8)
    where `batch` is not all: the events of the whole slab until its last batch

The plan is the one with the largest slabs whose sum is within the bound; with all maps at a time where the bound allows it, because
tiles of rows then are finished at once, and no map is drawn twice if one slab is all. Two things lie outside the bound's reach: the
scene's own triangles, and the finished functions. Both are taken off the bound as far as half of it; what they need beyond comes on
top.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.cameras import DV, V0, S
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.walk import BLOCK
from renderers.transport.threads import thread_count

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
# rows that are walked together: they read almost the same texels
TILE = 8
FOUND, SORTED, VERTEX = 9, 4, 8
# events a ray and map that room is made for: scenes have .3 to 1.2, more is found in smaller tiles
DENSITY = 1.5
# those that a slab which keeps its events is made for: with more it is done again in halves
KEPT = 0.75
# texels of a step of the walks beyond a ray's own, and of rounding
MARGIN = 2
PART = 16


class Plan(NamedTuple):
    """slabs: rows of the pyramid at a time. batch: shadow maps at a time, part: being drawn at a time. tile: rows that a thread
    walks, events: that it has room for. held: bytes of events that a slab may keep between batches. bytes: of all of it together.
    """

    slabs: list[range]
    batch: int
    part: int
    tile: int
    events: int
    held: int
    bytes: int


def plan_of(pyramid: Pyramid, cameras: F64, shape: tuple[int, int], memory: int, *, blocks: bool) -> Plan:
    """The plan for maps of `shape` (rows, columns) within `memory` bytes; blocks: maps are kept with the bounds of their blocks."""
    count, threads = len(cameras), thread_count()
    texel = 4 * (1 + 2 / BLOCK**2) if blocks else 4.0
    row = DENSITY * pyramid.width * count
    events = int(np.clip(memory // 5 // (threads * (FOUND + SORTED + VERTEX)), 4 * (pyramid.width + shape[1]), TILE * row + 4096))
    working = threads * events * (FOUND + SORTED + VERTEX)
    left = memory - working
    part = min(PART, count, max(threads, int(left // 16 // (shape[0] * shape[1] * 12))))
    tile = int(np.clip(events / row, 1, TILE))

    def drawn(slabs: list[range], batch: int) -> int:
        """Bytes of maps in the slab with the longest band."""
        rows = max(band_of(pyramid, cameras, slab, shape[0])[1] for slab in slabs)
        return int((batch * texel + part * 12) * rows * shape[1])

    kept = _slabs(pyramid.height, max(int(left / 2 // (FOUND * row / DENSITY * KEPT)), 1))
    for slabs in _divisions(pyramid.height, min(pyramid.height, tile)):
        # every slab draws a band of every map: fewer slabs are less work, however they are finished
        if len(slabs) > len(kept):
            break
        if (size := drawn(slabs, count)) <= left:
            return Plan(slabs, count, part, tile, events, 0, working + size)
    batch = _largest(lambda n: drawn(kept, n) <= left - left // 2, count)
    return Plan(kept, batch, part, tile, events, left // 2, working + left // 2 + drawn(kept, batch))


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


def _divisions(height: int, least: int) -> list[list[range]]:
    """Slabs from one of all rows down to those of `least` rows."""
    sizes = sorted({-(-height // k) for k in range(1, height // least + 1)}, reverse=True)
    return [_slabs(height, size) for size in sizes]


def _slabs(height: int, size: int) -> list[range]:
    return [range(start, min(start + size, height)) for start in range(0, height, size)]


def _largest(fits: Callable[[int], bool], most: int) -> int:
    """The largest number up to `most` that fits, at least 1; what fits does so for all smaller ones."""
    low, high = 1, most
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits(middle) else (low, middle - 1)
    return low
