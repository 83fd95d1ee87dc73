"""A worker's place in its data folder: a lock that it holds while it lives, and the name that goes with it."""

from __future__ import annotations

import os
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jobs.machine import only_one

MOST_WORKERS = 256


@contextmanager
def place(home: Path) -> Iterator[str]:
    """The name of a worker: the first place of this data folder that no live process holds, so a restart finds its own work."""
    for number in range(MOST_WORKERS):
        with only_one(_lock(home, str(number))) as ours:
            if ours:
                yield f"{_prefix(home)}-{number}"
                return
    raise RuntimeError(f"{MOST_WORKERS} workers have {home} already")


def lock_of(worker: str, home: Path) -> Path | None:
    """The lock that a worker of this name holds, None where it isn't a worker of this data folder on this machine."""
    prefix, _, number = worker.rpartition("-")
    return _lock(home, number) if prefix == _prefix(home) else None


def _lock(home: Path, number: str) -> Path:
    return home / "workers" / f"{number}.lock"


def _prefix(home: Path) -> str:
    return f"{socket.gethostname()}-{_name_of(home)}"


def _name_of(home: Path) -> str:
    """A name that tells this data folder from others of machines with the same name."""
    path = home / "workers" / "name"
    if not path.is_file():
        draft = path.with_name(f".name.{os.getpid()}")
        draft.write_text(uuid.uuid4().hex[:8])
        try:
            os.link(draft, path)
        except FileExistsError:
            pass  # another process was first
        finally:
            draft.unlink()
    return path.read_text()
