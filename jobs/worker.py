"""A worker: does the queue's work in child processes, says that it lives, and takes over from workers that don't.

Work goes on where a worker left it: at once when it starts again on its machine, and after the lease when another finds it silent.
A lease is no deadline: a worker that beats keeps its work however long that takes.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from jobs.artifacts import Artifacts
from jobs.durable import Client, Engine, Observer
from jobs.errors import StoreError
from jobs.machine import let_go, only_one
from jobs.process import run_task
from jobs.records import Records
from jobs.store import Store
from jobs.work import Bench, Runner

LEASE_S = 45.0
LONGEST_S = 6 * 3600.0
KEEP_DAYS = 90.0
MOST_WORKERS = 256
log = logging.getLogger(__name__)


class Worker:
    """Takes work from all queues: one timed render, one reference and two light nodes at once.

    database, store: as for JobQueue. lease_s: how long a worker may be silent before others take its work; more than the longest
    pause of the machine. wall_s, memory_bytes: limits of a child whose evaluation names none. nightly: called by one of
    all workers at the times of the cron line (UTC; None: never), after old evaluations and unused artefacts were removed.
    """

    def __init__(
        self, database: str | None = None, store: str | None = None, *, lease_s: float = LEASE_S, poll_s: float = 0.5,
        wall_s: float | None = LONGEST_S, memory_bytes: int | None = None, runner: Runner = run_task, home: Store | None = None,
        observer: Observer | None = None, nightly: Callable[[datetime], None] | None = None, cron: str | None = "0 3 * * *",
    ) -> None:  # fmt: skip
        self.home = home or Store()
        self.lease_s, self.poll_s = lease_s, poll_s
        self.records = Records(database or self.home.database)
        artifacts = Artifacts(store or self.home.artifacts)
        self.bench = Bench(artifacts, self.home, runner, wall_s=wall_s, memory_bytes=memory_bytes)
        self._observer, self._nightly, self._cron = observer, nightly, cron

    def run(self, stop_event: threading.Event) -> None:
        """Work until `stop_event` is set. What is under way then is ended and left for the next worker."""
        with self.working():
            stop_event.wait()

    @contextmanager
    def working(self) -> Iterator[None]:
        """Work while the block runs."""
        with _place(self.home.home) as executor:
            started = time.time()
            self.records.beat(executor, started, self.lease_s)
            engine = Engine(
                self.records.url, executor, self.records, self.bench, poll_s=self.poll_s, observer=self._observer,
                nightly=self._night, cron=self._cron,
            )  # fmt: skip
            client = Client(self.records.url)
            engine.start()
            ended = threading.Event()
            beat = threading.Thread(
                target=self._beat, args=(engine, client, started, ended), name="luxmeter-heartbeat", daemon=True
            )
            beat.start()
            try:
                yield
            finally:
                ended.set()
                beat.join()
                engine.stop()
                self.records.leave(executor)
                client.close()
                self.records.close()

    def _night(self, scheduled: datetime) -> None:
        """Clean up as LUXMETER_KEEP_DAYS and LUXMETER_KEEP_GIB say, then call the nightly function."""
        from jobs.queue import JobQueue
        from jobs.retention import clean_up, clean_up_runs

        days = float(os.environ.get("LUXMETER_KEEP_DAYS") or KEEP_DAYS)
        gib = os.environ.get("LUXMETER_KEEP_GIB")
        queue = JobQueue(self.records.url, self.bench.artifacts.url)
        try:
            removed = clean_up(queue, days=days, most_bytes=int(float(gib) * 2**30) if gib else None)
        finally:
            queue.close()
        clean_up_runs(self.home.home / "runs")
        log.info("clean-up: %s", removed)
        if self._nightly is not None:
            self._nightly(scheduled)

    def _beat(self, engine: Engine, client: Client, started: float, ended: threading.Event) -> None:
        while True:
            try:
                dead = self.records.beat(engine.executor, started, self.lease_s)
                if dead:
                    log.warning("taking over from %s", ", ".join(dead))
                    if any(_is_of(name, self.home.home) for name in dead):
                        let_go(self.home.home / "machine")
                    engine.recover(dead)
                for row in self.records.page("queued", 1000, None):  # a submitter may have died before it enqueued
                    client.enqueue(row["id"], row["attempt"], row["priority"])
            except StoreError as error:
                log.warning("heartbeat: %s", error)
            if ended.wait(self.lease_s / 4):
                return


@contextmanager
def _place(home: Path) -> Iterator[str]:
    """The name of a worker: the first place of this data folder that no live process holds, so a restart finds its own work."""
    for number in range(MOST_WORKERS):
        with only_one(home / "workers" / f"{number}.lock") as ours:
            if ours:
                yield f"{socket.gethostname()}-{_name_of(home)}-{number}"
                return
    raise RuntimeError(f"{MOST_WORKERS} workers have {home} already")


def _is_of(executor: str, home: Path) -> bool:
    """Whether this worker's data folder is that worker's too."""
    return executor.rsplit("-", 2)[1] == _name_of(home)


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
