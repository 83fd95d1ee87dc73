"""Memory that construction makes once and uses again: what was freed would partly stay with the allocator, over any bound."""

from __future__ import annotations

import mmap
from threading import Condition, Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]
VERTEX = 8


class Events(NamedTuple):
    """Changes of visibility: pixel (E,), its depth z, sign +1 (into shadow) or -1."""

    pixel: NDArray[np.int32]
    z: F32
    sign: NDArray[np.int8]

    def part(self, which: slice) -> Events:
        """Some of them, a view."""
        return Events(self.pixel[which], self.z[which], self.sign[which])


def events_of(count: int) -> Events:
    """Room for so many."""
    return Events(np.empty(count, np.int32), np.empty(count, np.float32), np.empty(count, np.int8))


class Room:
    """What one thread works in: events as found, sorted, and the vertices made of them."""

    def __init__(self, events: int) -> None:
        self.found = events_of(events)
        self.keys = np.empty(events, np.uint32)
        self.depth, self.value = np.empty(events, np.float32), np.empty(events, np.float32)

    def grow(self) -> None:
        """Twice the events: for a single pixel that has more."""
        self.__init__(2 * len(self.keys))  # type: ignore[misc]

    def hold(self, vertices: int) -> None:
        """Room for a function of so many vertices."""
        if vertices > len(self.depth):
            self.depth, self.value = np.empty(vertices, np.float32), np.empty(vertices, np.float32)


class Store:
    """Events of a slab's rows, kept from one batch of maps to the next; threads put them in as they come."""

    def __init__(self, events: int) -> None:
        self._events = events_of(events)
        self._lock = Lock()
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.count = 0
        self._parts: dict[int, list[slice]] = {}
        self._steps: dict[int, int] = {}

    def grow(self) -> None:
        """Twice the room, empty: for a single pixel that has more."""
        self._events = events_of(2 * len(self._events.z))

    def add(self, row: int, events: Events, steps: int) -> bool:
        """Keep a row's; False where there is no room."""
        with self._lock:
            into = slice(self.count, self.count + len(events.z))
            if into.stop > len(self._events.z):
                return False
            self.count = into.stop
            self._parts.setdefault(row, []).append(into)
            self._steps[row] = self._steps.get(row, 0) + steps
        kept = self._events
        kept.pixel[into], kept.z[into], kept.sign[into] = events
        return True

    def of(self, row: int) -> tuple[list[Events], int]:
        """A row's events, views, and the steps walked to find them."""
        return [self._events.part(part) for part in self._parts.get(row, [])], self._steps.get(row, 0)


class Column:
    """float32 numbers in memory of their own that grows without a copy: with an allocator's, the old room would stay behind."""

    def __init__(self, count: int) -> None:
        self._memory = mmap.mmap(-1, max(4 * count, 4), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self.array: F32 = np.frombuffer(self._memory, np.float32)

    def resize(self, count: int) -> None:
        """Room for so many; nobody else may hold the array."""
        del self.array
        self._memory.resize(max(4 * count, 4))
        self.array = np.frombuffer(self._memory, np.float32)


class Functions:
    """Finished functions, one after another, with room for `expected` vertices a pixel that grows where there are more.

    start (pixels + 1,) as far as they go. `limit`: bytes that they may take; `over`: they take more.
    """

    def __init__(self, pixels: int, expected: float) -> None:
        self.start = np.zeros(pixels + 1, np.int64)
        self._depth, self._value = (Column(int(expected * pixels)) for _ in range(2))
        self.limit = self.pixels = self.vertices = self.events = self.steps = 0

    @property
    def bytes(self) -> int:
        """Size of the vertices' room."""
        return VERTEX * len(self._depth.array)

    @property
    def over(self) -> bool:
        """Whether there are more bytes than may be."""
        return self.bytes > self.limit

    def add(self, counts: I64, depth: F32, value: F32, events: int, steps: int) -> None:
        """Append the functions of some pixels, from so many events."""
        first, last = self.vertices, self.vertices + len(depth)
        if last > len(self._depth.array):
            self._resize(max(last, min(last + last // 8, self.limit // VERTEX)))
        self._depth.array[first:last], self._value.array[first:last] = depth, value
        after = self.pixels + len(counts)
        self.start[self.pixels + 1 : after + 1] = first + np.cumsum(counts)
        self.pixels, self.vertices = after, last
        self.events += events
        self.steps += steps

    def finished(self) -> tuple[I64, F32, F32]:
        """start, depth and value, cut to size."""
        self._resize(self.vertices)
        return self.start, self._depth.array[: self.vertices], self._value.array[: self.vertices]

    def _resize(self, vertices: int) -> None:
        self._depth.resize(vertices)
        self._value.resize(vertices)


class Turns:
    """Numbered pieces of work that pass one after another, whoever does them."""

    def __init__(self) -> None:
        self._next = 0
        self._changed = Condition()

    def wait(self, number: int) -> None:
        """Until all before it have passed."""
        with self._changed:
            self._changed.wait_for(lambda: self._next == number)

    def passed(self, number: int) -> None:
        """Let the next one pass; waits for its own turn first."""
        self.wait(number)
        with self._changed:
            self._next = number + 1
            self._changed.notify_all()
