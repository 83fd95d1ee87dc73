"""A worker's heartbeat: says that it lives, and takes over from workers that don't.

Work is fenced, so it is never wrong to take it over, only wasteful: whoever loses it can't record what became of it.
"""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path

import sqlalchemy as sa

from jobs.database import file_of
from jobs.durable.client import Client
from jobs.durable.engine import Engine
from jobs.errors import StoreError
from jobs.machine import holder, let_go
from jobs.place import lock_of
from jobs.points import reach
from jobs.records import Records
from jobs.stopped import end_tasks, keepers, wake

log = logging.getLogger(__name__)


class Heartbeat:
    """Beats four times a lease from a thread of its own, over a connection of its own that waits for nobody longer than that.

    home: the worker's data folder; lease_s: how long a worker may be silent.
    """

    def __init__(self, url: str, executor: str, home: Path, lease_s: float) -> None:
        self._url, self._executor, self._home, self._lease_s = url, executor, home, lease_s
        self._started = time.time()
        self._records = Records(url, wait_s=lease_s / 4, idle_s=lease_s, flush=False)
        self._dead: list[str] = []
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def announce(self) -> None:
        """Say that this worker lives: before it takes any work, which would look like a dead one's. Raises StoreError."""
        end = time.monotonic() + 2 * self._lease_s
        while True:
            try:
                self._say()
                return
            except StoreError:
                if time.monotonic() > end:
                    raise
            time.sleep(self._lease_s / 16)

    def start(self, engine: Engine, client: Client) -> None:
        """Begin to beat; the engine runs."""
        self._thread = threading.Thread(target=self._run, args=(engine, client), name="luxmeter-heartbeat", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Beat no more."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def leave(self) -> None:
        """Whoever is left may take over at once."""
        try:
            self._records.leave(self._executor)
        finally:
            self._records.close()

    def _run(self, engine: Engine, client: Client) -> None:
        while True:
            try:
                self._beat(engine, client)
            except (StoreError, sa.exc.SQLAlchemyError) as error:  # the next beat may find it there again
                log.warning("heartbeat: %s", error)
            except Exception:  # the thread's edge: a worker that falls silent loses all its work
                log.exception("heartbeat")
            if self._ended.wait(self._lease_s / 4):
                return

    def _beat(self, engine: Engine, client: Client) -> None:
        self._say()
        if self._dead:
            reach("takeover before recovery")
        engine.recover(self._dead)
        self._dead.clear()
        engine.sweep({row["id"] for row in self._records.workers()})
        for row in self._records.page("queued", 1000, None):  # a submitter may have died before it enqueued
            client.enqueue(row["id"], row["attempt"], row["priority"])

    def _say(self) -> None:
        """Say that this worker lives, and note those that don't any more."""
        self._free_the_database()
        dead = self._records.beat(self._executor, self._started, self._lease_s)
        for name in dead:
            log.warning("taking over from %s", name)
            self._free_the_machine(name)
            self._dead.append(name)

    def _free_the_machine(self, name: str) -> None:
        """A worker that is stopped keeps the machine, and its children go on beside our timed work: end both."""
        pid = self._holder(name)
        if pid is not None:
            let_go(self._home / "machine")
            log.warning("%s is stopped or stuck: ended %d of its tasks", name, end_tasks(pid))

    def _free_the_database(self) -> None:
        """Whoever is stopped with a lock on an SQLite file keeps everyone from it: let it go on, so that it lets go."""
        path = file_of(self._url)  # PostgreSQL itself ends a transaction that stands still
        for pid in [] if path is None else keepers(path):
            if wake(pid):
                log.warning("woke process %d, which was stopped and held the database", pid)

    def _holder(self, name: str) -> int | None:
        """Process id of a worker of this data folder whose process is there."""
        lock = lock_of(name, self._home)
        return None if lock is None else holder(lock)
