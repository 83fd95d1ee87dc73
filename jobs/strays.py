"""Work that a worker has taken and that nobody does.

A worker that dies loses its work to whoever misses its heartbeat. That leaves two gaps: whoever missed it may die before it has
put the work back; and a live worker can lose hold of what it took, when the database refuses to keep a step, for want of space say.
Both leave work that is taken in the database by an executor that isn't there or isn't at it. What was found so twice, some time
apart, is a stray.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

PATIENCE_S = 10.0  # more than it takes a worker from taking work to being at it


class Stray(NamedTuple):
    """A workflow, the executor that took it, and when it did."""

    workflow: str
    executor: str
    since: int | None


class Strays:
    """What this executor is at, and what was found to be left by it or by others."""

    def __init__(self, executor: str, patience_s: float = PATIENCE_S) -> None:
        self._executor, self._patience_s = executor, patience_s
        self._at_work: Counter[str] = Counter()
        self._found: dict[Stray, float] = {}
        self._lock = threading.Lock()

    @contextmanager
    def at_work(self, workflow: str) -> Iterator[None]:
        """This executor is at a workflow while the block runs."""
        with self._lock:
            self._at_work[workflow] += 1
        try:
            yield
        finally:
            with self._lock:
                self._at_work[workflow] -= 1
                self._at_work += Counter()  # drops what is at zero

    def among(self, taken: Iterable[Stray], live: set[str], now: float) -> list[Stray]:
        """Those of the workflows taken that nobody is at since the patience. live: executors that live; now: seconds, monotonic."""
        with self._lock:
            here = set(self._at_work)
        left = [one for one in taken if (one.workflow not in here if one.executor == self._executor else one.executor not in live)]
        self._found = {one: self._found.get(one, now) for one in left}
        strays = [one for one, since in self._found.items() if now - since >= self._patience_s]
        for one in strays:
            del self._found[one]
        return strays
