"""A worker: does the queue's work in child processes, says that it lives, and takes over from workers that don't.

Work goes on where a worker left it: at once when it starts again on its machine, and after the lease when another finds it silent.
A lease is no deadline: a worker that beats keeps its work however long that takes.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime

from jobs.artifacts import Artifacts
from jobs.database import IDLE_S
from jobs.durable.client import Client
from jobs.durable.engine import Engine
from jobs.durable.station import Observer
from jobs.heartbeat import Heartbeat
from jobs.leftovers import clean_up_machine
from jobs.place import place
from jobs.process import run_task
from jobs.records import Records
from jobs.store import Store
from jobs.work import Bench, Runner

LEASE_S = 45.0
LONGEST_S = 6 * 3600.0
KEEP_DAYS = 90.0
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
        self.records = Records(database or self.home.database, idle_s=min(lease_s, IDLE_S), flush=False)
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
        with place(self.home.home) as executor, ExitStack() as after:
            after.callback(self.records.close)
            clean_up_machine(self.home.home)
            heartbeat = Heartbeat(self.records.url, executor, self.home.home, self.lease_s)
            after.callback(heartbeat.leave)
            heartbeat.announce()
            client = Client(self.records.url)
            after.callback(client.close)
            client.register(self.poll_s)
            engine = Engine(
                self.records.url, executor, self.records, self.bench, poll_s=self.poll_s, idle_s=min(self.lease_s, IDLE_S),
                observer=self._observer, nightly=self._night, cron=self._cron,
            )  # fmt: skip
            engine.start()
            after.callback(engine.stop)
            heartbeat.start(engine, client)
            after.callback(heartbeat.stop)
            yield

    def _night(self, scheduled: datetime) -> None:
        """Clean up as LUXMETER_KEEP_DAYS and LUXMETER_KEEP_GIB say, then call the nightly function."""
        from jobs.queue import JobQueue
        from jobs.retention import clean_up

        days = float(os.environ.get("LUXMETER_KEEP_DAYS") or KEEP_DAYS)
        gib = os.environ.get("LUXMETER_KEEP_GIB")
        queue = JobQueue(self.records.url, self.bench.artifacts.url)
        try:
            removed = clean_up(queue, days=days, most_bytes=int(float(gib) * 2**30) if gib else None)
        finally:
            queue.close()
        clean_up_machine(self.home.home)
        log.info("clean-up: %s", removed)
        if self._nightly is not None:
            self._nightly(scheduled)
