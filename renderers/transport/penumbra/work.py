"""The work of one construction under its plan: draw bands of shadow maps, find the events in them, finish functions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.lockstep import Grid, interleaved, tile_events
from renderers.transport.penumbra.plan import Plan, band_of
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.reduce import functions, sorted_keys
from renderers.transport.penumbra.walk import bounds_of, row_events
from renderers.transport.threads import chunks, in_threads, thread_count

if TYPE_CHECKING:
    from renderers.transport.penumbra.assemble import Construction, MapMaker

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Events(NamedTuple):
    pixel: NDArray[np.int32]
    z: F32
    sign: NDArray[np.int8]


class Maps(NamedTuple):
    """Bands of shadow maps from row `top` (N,) on: depths (N, h, w) with the bounds of their blocks; or interleaved for the
    lockstep, without.
    """

    top: I64
    depth: F32
    low: F32 | None = None
    high: F32 | None = None


class Tile(NamedTuple):
    """Finished functions of some pixels."""

    counts: I64
    depth: F32
    value: F32
    events: int
    steps: int


class Room:
    """What one thread works in: events as found, sorted, and the vertices made of them."""

    def __init__(self, events: int) -> None:
        self.pixel, self.z, self.sign = np.empty(events, np.int32), np.empty(events, np.float32), np.empty(events, np.int8)
        self.keys = np.empty(events, np.uint32)
        self.depth, self.value = np.empty(events, np.float32), np.empty(events, np.float32)

    def kept(self, count: int) -> Events:
        """A copy of the first events."""
        return Events(self.pixel[:count].copy(), self.z[:count].copy(), self.sign[:count].copy())


class Functions:
    """Finished tiles, one after another in arrays that grow in place; start (pixels + 1,) as far as they go."""

    def __init__(self, pixels: int) -> None:
        self.start = np.zeros(pixels + 1, np.int64)
        self.depth, self.value = np.empty(0, np.float32), np.empty(0, np.float32)
        self.pixels = self.events = self.steps = 0

    def add(self, tile: Tile) -> None:
        """Append a tile."""
        first, last = len(self.depth), len(self.depth) + len(tile.depth)
        # nobody else holds these arrays
        self.depth.resize(last, refcheck=False)
        self.value.resize(last, refcheck=False)
        self.depth[first:], self.value[first:] = tile.depth, tile.value
        after = self.pixels + len(tile.counts)
        self.start[self.pixels + 1 : after + 1] = first + np.cumsum(tile.counts)
        self.pixels = after
        self.events += tile.events
        self.steps += tile.steps


class Work:
    """One construction: draws bands of maps, finds events, finishes functions."""

    def __init__(self, pyramid: Pyramid, cameras: F64, maps: MapMaker, how: Construction, grid: Grid | None, plan: Plan) -> None:
        self.pyramid, self.cameras, self.how, self.plan = pyramid, cameras, how, plan
        self._maps, self._grid = maps, grid
        self._rooms: SimpleQueue[Room] = SimpleQueue()
        for _ in range(thread_count()):
            self._rooms.put(Room(plan.events))

    def build(self, slab: range, done: Functions, tally: Counter[str]) -> None:
        """Finish the rows of a slab, in order."""
        if self.plan.batch >= len(self.cameras):
            maps = self._drawn(slice(None), slab, tally)
            waves = chunks(len(slab), self.plan.tile * 4 * thread_count())
            for wave in waves:
                tiles = [slab[wave][part] for part in chunks(len(slab[wave]), self.plan.tile)]
                for finished in in_threads(lambda rows: self._finished(maps, rows), tiles):
                    for tile in finished:
                        done.add(tile)
            return
        held = self._held(slab, tally)
        if held is None:
            middle = slab.start + len(slab) // 2
            self.build(range(slab.start, middle), done, tally)
            self.build(range(middle, slab.stop), done, tally)
            return
        for row in range(len(slab)):
            parts, steps = held[row]
            held[row] = ([], 0)
            with self._room() as room:
                for tile in self._reduced(self.pyramid.width, parts, steps, room):
                    done.add(tile)

    def _held(self, slab: range, tally: Counter[str]) -> list[tuple[list[Events], int]] | None:
        """Events of each row in all maps, batch after batch, and the steps walked; None where the slab has too many."""
        held: list[tuple[list[Events], int]] = [([], 0) for _ in slab]
        rows = [range(row, row + 1) for row in slab]
        size = 0
        for batch in chunks(len(self.cameras), self.plan.batch):
            maps = self._drawn(batch, slab, tally)
            found = in_threads(lambda row, m=maps, b=batch: self._found(m, b, row), rows)  # type: ignore[misc]
            for k, (events, walked) in enumerate(found):
                held[k] = ([*held[k][0], events], held[k][1] + walked)
                size += sum(column.nbytes for column in events)
            if size > self.plan.held and len(slab) > 1:
                return None
        return held

    def _drawn(self, which: slice, rows: range, tally: Counter[str]) -> Maps:
        """Bands of the maps of some cameras for rows of the pyramid; a few at a time are interleaved, so that they don't exist
        twice.
        """
        cameras = self.cameras[which]
        top, height = band_of(self.pyramid, self.cameras, rows, self._maps.shape[0])
        top = top[which]
        width = self._maps.shape[1]
        fine = 1 if self._grid is None else self._grid.fine
        out = np.empty((len(cameras), height, fine, width // fine), np.float32)
        for part in chunks(len(cameras), self.plan.part):
            if fine == 1:
                self._maps.draw(cameras[part], top[part], out[part, :, 0])
                continue
            made = np.empty((len(cameras[part]), height, width), np.float32)
            self._maps.draw(cameras[part], top[part], made)
            out[part] = interleaved(made, self._grid)  # type: ignore[arg-type]
        tally["shadow_maps"] += len(cameras)
        if self._grid is not None:
            return Maps(top, out)
        return Maps(top, out[:, :, 0], *bounds_of(out[:, :, 0]))

    def _walked(self, maps: Maps, which: slice, rows: range, room: Room) -> tuple[int, int]:
        """Events of some rows in these maps, put into `room`: how many (-1: too many) and the steps walked."""
        p, cameras = self.pyramid, self.cameras[which]
        vs = p.vs[rows.start : rows.stop]
        into = (room.pixel, room.z, room.sign)
        if self._grid is not None:
            return tile_events(maps.depth, cameras, maps.top, p.us, vs, p.near, p.far, self.how.bias, self._grid.coarse, *into)  # type: ignore[no-any-return]
        bounds = (maps.depth, maps.low, maps.high)
        exact = self.how.walk == "exact"
        return row_events(*bounds, cameras, maps.top, p.us, vs, p.near, p.far, self.how.bias, exact, *into)  # type: ignore[no-any-return]

    def _found(self, maps: Maps, which: slice, rows: range) -> tuple[Events, int]:
        """Events of some rows, in arrays of their own."""
        with self._room() as room:
            count, steps = self._walked(maps, which, rows, room)
            size = len(room.z)
            while count < 0:
                size *= 2
                more = Room(size)
                count, steps = self._walked(maps, which, rows, more)
                if count >= 0:
                    return more.kept(count), steps
            return room.kept(count), steps

    def _finished(self, maps: Maps, rows: range) -> list[Tile]:
        """Functions of some rows from all maps, in halves where they have too many events."""
        with self._room() as room:
            count, steps = self._walked(maps, slice(None), rows, room)
            if count >= 0:
                events = Events(room.pixel[:count], room.z[:count], room.sign[:count])
                return list(self._reduced(self.pyramid.width * len(rows), [events], steps, room))
        if len(rows) > 1:
            middle = rows.start + len(rows) // 2
            return self._finished(maps, range(rows.start, middle)) + self._finished(maps, range(middle, rows.stop))
        events, steps = self._found(maps, slice(None), rows)
        with self._room() as room:
            return list(self._reduced(self.pyramid.width, [events], steps, room))

    def _reduced(self, pixels: int, parts: list[Events], steps: int, room: Room) -> Iterator[Tile]:
        """Functions of some pixels, from parts of their events."""
        start = np.zeros(pixels + 1, np.int64)
        for part in parts:
            start[1:] += np.bincount(part.pixel, minlength=pixels)
        # a function has at most two vertices an event
        longest = 2 * int(start.max()) + 4
        np.cumsum(start, out=start)
        count = int(start[-1])
        keys = room.keys if count <= len(room.keys) else np.empty(count, np.uint32)
        depth, value = (a if longest <= len(a) else np.empty(longest, np.float32) for a in (room.depth, room.value))
        place = start[:-1].copy()
        for part in parts:
            sorted_keys(*part, place, keys)
        how = self.how
        merge, scale = how.interval(self.pyramid), how.scale(self.pyramid)
        first = 0
        while first < pixels:
            counts = np.zeros(pixels, np.int64)
            after, total = functions(
                start, keys, first, len(self.cameras), merge, how.metric, how.epsilon, scale, how.budget, counts, depth, value
            )
            new = int(start[after] - start[first])
            yield Tile(counts[first:after].copy(), depth[:total].copy(), value[:total].copy(), new, steps if first == 0 else 0)
            first = after

    @contextmanager
    def _room(self) -> Iterator[Room]:
        """A room that no other thread works in."""
        room = self._rooms.get()
        try:
            yield room
        finally:
            self._rooms.put(room)
