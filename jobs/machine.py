"""Who may use the machine: timed work has it alone, other work shares it. Holds across all processes with one data folder.

Two files are locked as the kernel locks files, so a lock ends with the process that holds it, however that ends. Whoever comes
takes `turn` first and keeps it while waiting for `room`: an exclusive taker that waits lets nobody else in before it, and neither
starves.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

POLL_S = 0.03


@contextmanager
def use_of(folder: Path, *, alone: bool, stop: Callable[[], None]) -> Iterator[None]:
    """Hold the machine while the block runs. `stop` is called while waiting, and ends the wait by raising."""
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder / "room.lock", shared=not alone, stop=stop, turn=folder / "turn.lock"):
        yield


@contextmanager
def only_one(path: Path) -> Iterator[bool]:
    """Try to be the only live process that holds `path`; yields whether this one is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        yield _try(handle, fcntl.LOCK_EX)
    finally:
        os.close(handle)


@contextmanager
def _locked(path: Path, *, shared: bool, stop: Callable[[], None], turn: Path | None = None) -> Iterator[None]:
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        if turn is None:
            _wait(handle, shared, stop)
        else:
            with _locked(turn, shared=False, stop=stop):
                _wait(handle, shared, stop)
        yield
    finally:
        os.close(handle)


def _wait(handle: int, shared: bool, stop: Callable[[], None]) -> None:
    while not _try(handle, fcntl.LOCK_SH if shared else fcntl.LOCK_EX):
        stop()
        time.sleep(POLL_S)


def _try(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
