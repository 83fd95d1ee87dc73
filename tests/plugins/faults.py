"""Disks and databases that run full, or that can only be read."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg.errors
import sqlalchemy as sa

ROOM = 2**30
SQLITE = {"full": "pragma max_page_count=1", "read-only": "pragma query_only=1"}  # of an open file: never less than it has
POSTGRES = {
    "full": (psycopg.errors.DiskFull, 'could not extend file "base/1/2": No space left on device'),
    "read-only": (psycopg.errors.ReadOnlySqlTransaction, "cannot execute INSERT in a read-only transaction"),
}
WORDS = {"full": "database or disk is full|No space left on device", "read-only": "readonly database|read-only transaction"}


class Fault:
    """While it is on, all connections of this process to its databases meet it. SQLite's own limits on SQLite, on PostgreSQL its
    own errors, raised where its driver would."""

    def __init__(self, kind: str) -> None:
        self.kind, self.on, self.met = kind, threading.Event(), threading.Event()

    def checkout(self, connection: Any, record: Any, proxy: Any) -> None:
        """SQLite: set or lift the limit when a connection is taken from its pool."""
        if type(connection).__module__.startswith("sqlite3"):
            connection.execute(SQLITE[self.kind] if self.on.is_set() else f"pragma max_page_count={ROOM}")
            if not self.on.is_set():
                connection.execute("pragma query_only=0")

    def do_execute(self, cursor: Any, statement: str, parameters: Any, context: Any) -> None:
        """PostgreSQL: refuse to write."""
        if self.on.is_set() and type(cursor).__module__.startswith("psycopg") and _writes(statement):
            error, words = POSTGRES[self.kind]
            raise error(words)

    def seen(self, context: sa.engine.ExceptionContext) -> None:
        """Note that the database refused something."""
        if self.on.is_set():
            self.met.set()


@contextmanager
def faulty(kind: str) -> Iterator[Fault]:
    """A fault of every database of this process; off at first."""
    fault = Fault(kind)
    listeners = [
        (sa.pool.Pool, "checkout", fault.checkout), (sa.Engine, "do_execute", fault.do_execute),
        (sa.Engine, "do_executemany", fault.do_execute), (sa.Engine, "handle_error", fault.seen),
    ]  # fmt: skip
    for target, name, function in listeners:
        sa.event.listen(target, name, function)
    try:
        yield fault
    finally:
        fault.on.clear()
        for target, name, function in listeners:
            sa.event.remove(target, name, function)


@contextmanager
def small_disk(folder: Path, mib: int) -> Iterator[Path]:
    """A file system of its own in memory. Raises PermissionError where mounting is not allowed."""
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={mib}m", "tmpfs", str(folder)], capture_output=True, text=True, check=False
    )
    if mounted.returncode != 0:
        raise PermissionError(mounted.stderr.strip())
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(disk: Path) -> Path:
    """Fill a disk to the last byte; the file that does."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as stream:
        try:
            while stream.write(bytes(4096)):
                pass
        except OSError:
            return ballast
    raise AssertionError("the disk has no end")


def _writes(statement: str) -> bool:
    return statement.lstrip().split(None, 1)[0].upper() in ("INSERT", "UPDATE", "DELETE")
