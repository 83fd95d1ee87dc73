"""Waiting for what other threads and processes do. The deadlines are for what never comes: a busy machine is far from them."""

from __future__ import annotations

import time
from collections.abc import Callable

from jobs.queue import JobQueue, Status


def until(condition: Callable[[], object], what: str, seconds: float = 180.0) -> None:
    """Return once the condition holds; AssertionError with `what` when it has not for that many seconds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.03)


def finished(queue: JobQueue, id: str) -> Status:
    """The evaluation, once it has ended."""
    until(lambda: queue.status(id).finished is not None, f"{id} did not end")
    return queue.status(id)
