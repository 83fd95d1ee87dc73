"""The work of one construction under its plan: draw bands of shadow maps, find the events in them, finish functions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.lockstep import Grid, interleaved, tile_events
from renderers.transport.penumbra.plan import Plan, band_of
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.reduce import count_events, functions, sorted_keys
from renderers.transport.penumbra.room import Events, Functions, Room, Store, Turns
from renderers.transport.penumbra.walk import bounds_of, row_events
from renderers.transport.threads import chunks, in_threads, thread_count

if TYPE_CHECKING:
    from renderers.transport.penumbra.assemble import Construction, MapMaker

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
ALL = slice(None)


class Maps(NamedTuple):
    """Bands of shadow maps from row `top` (N,) on: depths (N, h, w) with the bounds of their blocks; or interleaved for the
    lockstep, without.
    """

    top: I64
    depth: F32
    low: F32 | None = None
    high: F32 | None = None


class Block(NamedTuple):
    """Pixels of some rows and columns; several rows are whole."""

    rows: range
    columns: range

    @property
    def pixels(self) -> int:
        """How many."""
        return len(self.rows) * len(self.columns)

    def halves(self) -> tuple[Block, Block]:
        """Two blocks, of pixels one after another."""
        if len(self.rows) > 1:
            middle = len(self.rows) // 2
            return Block(self.rows[:middle], self.columns), Block(self.rows[middle:], self.columns)
        middle = len(self.columns) // 2
        return Block(self.rows, self.columns[:middle]), Block(self.rows, self.columns[middle:])


class Work:
    """One construction: draws bands of maps, finds events, finishes functions."""

    def __init__(
        self, pyramid: Pyramid, cameras: F64, maps: MapMaker, how: Construction, grid: Grid | None, plan: Plan, done: Functions,
        tally: Counter[str],
    ) -> None:  # fmt: skip
        self.pyramid, self.cameras, self.how, self.plan = pyramid, cameras, how, plan
        self._maps, self._grid, self._done, self._tally = maps, grid, done, tally
        band = plan.rows * maps.shape[1]
        self._bands = np.empty(plan.batch * band, np.float32)
        self._drawing = np.empty(plan.part * 3 * band, np.float32)
        self._store = Store(plan.kept)
        self._rooms: SimpleQueue[Room] = SimpleQueue()
        for _ in range(thread_count()):
            self._rooms.put(Room(plan.events))

    def build(self, slab: range) -> None:
        """Finish the rows of a slab, in order; fewer where the functions take more than they may."""
        if self.plan.batch >= len(self.cameras):
            maps = self._drawn(ALL, slab)
            blocks = [Block(slab[part], range(self.pyramid.width)) for part in chunks(len(slab), self.plan.tile)]
            self._in_turn(blocks, lambda block, room, pass_on: self._walk_and_reduce(maps, block, room, pass_on))
        else:
            self._build_from_batches(Block(slab, range(self.pyramid.width)))

    def _build_from_batches(self, block: Block) -> None:
        """The same, keeping events from one batch of maps to the next; in halves where the store is too small for that."""
        while not self._keep_all(block):
            if block.pixels > 1:
                for half in block.halves():
                    self._build_from_batches(half)
                return
            self._store.grow()
        rows = [Block(block.rows[k : k + 1], block.columns) for k in range(len(block.rows))]
        self._in_turn(rows, self._reduce_kept)

    def _in_turn(self, blocks: list[Block], work: Callable[[Block, Room, Callable[[], bool]], None]) -> None:
        """work(block, room, pass_on) in threads. It calls pass_on() before it appends functions: that waits until all blocks before
        are done, and answers whether functions may grow still: those of a row that was begun may.
        """
        turns, done, width = Turns(), self._done, self.pyramid.width

        def one(number: int) -> None:
            def pass_on() -> bool:
                turns.wait(number)
                return not done.over or done.pixels % width > 0

            with self._room() as room:
                try:
                    work(blocks[number], room, pass_on)
                finally:
                    turns.passed(number)

        in_threads(one, range(len(blocks)))

    def _drawn(self, which: slice, rows: range) -> Maps:
        """Bands of the maps of some cameras for rows of the pyramid."""
        cameras = self.cameras[which]
        top, height = band_of(self.pyramid, self.cameras, rows, self._maps.shape[0])
        top, width = top[which], self._maps.shape[1]
        fine = 1 if self._grid is None else self._grid.fine
        out = self._bands[: len(cameras) * height * width].reshape(-1, height, fine, width // fine)
        for part in chunks(len(cameras), self.plan.part):
            count = len(cameras[part])
            three = self._drawing[: 3 * count * height * width].reshape(3, count, height, width)
            if fine == 1:
                self._maps.draw(cameras[part], top[part], out[part, :, 0], three[1:])
                continue
            self._maps.draw(cameras[part], top[part], three[0], three[1:])
            out[part] = interleaved(three[0], self._grid)  # type: ignore[arg-type]
        self._tally["shadow_maps"] += len(cameras)
        if self._grid is not None:
            return Maps(top, out)
        return Maps(top, out[:, :, 0], *bounds_of(out[:, :, 0]))

    def _walked(self, maps: Maps, which: slice, block: Block, room: Room) -> tuple[int, int]:
        """Events of a block in these maps, put into `room`: how many (-1: too many) and the steps walked."""
        p, cameras = self.pyramid, self.cameras[which]
        us, vs = p.us[block.columns.start : block.columns.stop], p.vs[block.rows.start : block.rows.stop]
        if self._grid is not None:
            grid = self._grid.coarse
            return tile_events(maps.depth, cameras, maps.top, us, vs, p.near, p.far, self.how.bias, grid, *room.found)  # type: ignore[no-any-return]
        bounds = (maps.depth, maps.low, maps.high)
        exact = self.how.walk == "exact"
        return row_events(*bounds, cameras, maps.top, us, vs, p.near, p.far, self.how.bias, exact, *room.found)  # type: ignore[no-any-return]

    def _keep_all(self, block: Block) -> bool:
        """Put the block's events in all maps into the store, batch after batch; False where it is too small."""
        self._store.clear()
        rows = [Block(block.rows[k : k + 1], block.columns) for k in range(len(block.rows))]
        for batch in chunks(len(self.cameras), self.plan.batch):
            maps = self._drawn(batch, block.rows)

            def keep(row: Block, maps: Maps = maps, batch: slice = batch) -> bool:
                with self._room() as room:
                    return self._keep(maps, batch, row, row.columns.start, room)

            if not all(in_threads(keep, rows)):
                return False
        return True

    def _keep(self, maps: Maps, which: slice, row: Block, first: int, room: Room) -> bool:
        """Events of a row, or of some of its columns, in these maps; their pixels count from column `first`."""
        count, steps = self._walked(maps, which, row, room)
        if count >= 0:
            events = room.found.part(slice(count))
            events.pixel[:] += row.columns.start - first
            return self._store.add(row.rows.start, events, steps)
        if row.pixels == 1:
            room.grow()
            return self._keep(maps, which, row, first, room)
        return all(self._keep(maps, which, half, first, room) for half in row.halves())

    def _reduce_kept(self, row: Block, room: Room, pass_on: Callable[[], bool]) -> None:
        parts, steps = self._store.of(row.rows.start)
        self._reduce(row.pixels, parts, steps, room, pass_on)

    def _walk_and_reduce(self, maps: Maps, block: Block, room: Room, pass_on: Callable[[], bool]) -> None:
        """Functions of a block from all maps, in halves where it has too many events."""
        count, steps = self._walked(maps, ALL, block, room)
        if count >= 0:
            self._reduce(block.pixels, [room.found.part(slice(count))], steps, room, pass_on)
        elif block.pixels == 1:
            room.grow()
            self._walk_and_reduce(maps, block, room, pass_on)
        else:
            for half in block.halves():
                self._walk_and_reduce(maps, half, room, pass_on)

    def _reduce(self, pixels: int, parts: list[Events], steps: int, room: Room, pass_on: Callable[[], bool]) -> None:
        """Functions of some pixels, from parts of their events: as many at a time as there is room for."""
        how, merge, scale = self.how, self.how.interval(self.pyramid), self.how.scale(self.pyramid)
        counted = np.zeros(pixels, np.int64)
        for part in parts:
            count_events(part.pixel, counted)
        # a function has at most two vertices an event
        room.hold(2 * int(counted.max()) + 4)
        for group in _groups(counted, len(room.keys)):
            start = np.concatenate([[0], np.cumsum(counted[group])])
            keys = room.keys if start[-1] <= len(room.keys) else np.empty(start[-1], np.uint32)
            place = start[:-1].copy()
            for part in parts:
                sorted_keys(*part, group.start, place, keys)
            first, size = 0, len(start) - 1
            while first < size:
                counts = np.zeros(size, np.int64)
                after, total = functions(
                    start, keys, first, len(self.cameras), merge, how.metric, how.epsilon, scale, how.budget, counts, room.depth,
                    room.value,
                )  # fmt: skip
                if not pass_on():
                    return
                events = int(start[after] - start[first])
                self._done.add(counts[first:after], room.depth[:total], room.value[:total], events, steps)
                first, steps = after, 0

    @contextmanager
    def _room(self) -> Iterator[Room]:
        """A room that no other thread works in."""
        room = self._rooms.get()
        try:
            yield room
        finally:
            self._rooms.put(room)


def _groups(counts: I64, most: int) -> Iterator[slice]:
    """Pixels one after another with at most so many events together, or a single one with more."""
    first = 0
    total = np.cumsum(counts)
    while first < len(counts):
        before = int(total[first - 1]) if first else 0
        last = max(int(np.searchsorted(total, before + most, side="right")), first + 1)
        yield slice(first, last)
        first = last
