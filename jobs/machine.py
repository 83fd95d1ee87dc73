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
from contextlib import contextmanager, nullcontext
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
    """Try to be the only live process that holds `path`; yields whether this one is. The file says which process it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        ours = _try(handle, fcntl.LOCK_EX)
        if ours:
            os.truncate(handle, 0)
            os.pwrite(handle, str(os.getpid()).encode(), 0)
        yield ours
    finally:
        os.close(handle)


def holder(path: Path) -> int | None:
    """Process id of the live process that holds `path`, None where none does."""
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        if _try(stream.fileno(), fcntl.LOCK_EX):
            return None
        text = stream.read()
    return int(text) if text.isdigit() else None


def let_go(folder: Path) -> None:
    """Take the machine from whoever holds it: a process that is stopped, not dead, would keep it for ever. Its work is given up."""
    for name in ("room.lock", "turn.lock"):
        (folder / name).unlink(missing_ok=True)


@contextmanager
def _locked(path: Path, *, shared: bool, stop: Callable[[], None], turn: Path | None = None) -> Iterator[None]:
    with nullcontext() if turn is None else _locked(turn, shared=False, stop=stop):
        handle = _wait(path, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, stop)
    try:
        yield
    finally:
        os.close(handle)


def _wait(path: Path, kind: int, stop: Callable[[], None]) -> int:
    """A descriptor that holds the lock on the file that `path` names now: `let_go` makes it another one."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        if _try(handle, kind) and _is(handle, path):
            return handle
        os.close(handle)
        stop()
        time.sleep(POLL_S)


def _is(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _try(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
