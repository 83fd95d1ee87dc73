"""Runs workflows in this process."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any

from dbos import DBOS

from jobs.database import IDLE_S, WithoutFlush, is_sqlite, prepare_file, readable_errors
from jobs.durable import workflows
from jobs.durable.recovery import look, requeue, taken
from jobs.durable.station import Observer, Station, enter
from jobs.durable.wire import LIMITS, NAME, VERSION, Json, address
from jobs.monitor import Monitor
from jobs.records import Records
from jobs.strays import PATIENCE_S, Strays
from jobs.work import Bench

log = logging.getLogger(__name__)


class Engine:
    """One engine a process. Between `start` and `stop`, work of all queues is taken.

    executor: name of this worker, unique among the live ones, and the same after a restart. idle_s: how long a transaction, or work
    that was taken, may stand still before others get on with it. nightly: called when `cron` says.
    """

    def __init__(
        self, url: str, executor: str, records: Records, bench: Bench, *, poll_s: float = 0.5, idle_s: float = IDLE_S,
        observer: Observer | None = None, nightly: Callable[[datetime], None], cron: str | None,
    ) -> None:  # fmt: skip
        self.url, self.executor, self.poll_s, self.idle_s, self.cron = url, executor, poll_s, idle_s, cron
        self._monitor = Monitor(records, executor, look)
        self._strays = Strays(executor, min(idle_s, PATIENCE_S))
        self._station = Station(
            executor, records, bench, self._monitor, self._strays, poll_s=poll_s, observer=observer, nightly=nightly
        )

    def start(self) -> None:
        """Take up what this executor left when it died, and begin to take work from the queues that a Client has registered."""
        with readable_errors(self.url):
            prepare_file(self.url)
            DBOS(
                config={
                    "name": NAME, "system_database_url": address(self.url), "executor_id": self.executor, "serializer": Json(),
                    "application_version": VERSION, "log_level": "ERROR", "scheduler_polling_interval_sec": 2.0,
                    "notification_listener_polling_interval_sec": self.poll_s, "use_listen_notify": False,
                    "sys_db_idle_transaction_timeout_sec": self.idle_s, "db_engine_kwargs": _connecting(self.url),
                }
            )  # fmt: skip
            enter(self._station)
            DBOS.listen_queues(list(LIMITS))
            DBOS.launch()
            if self.cron is not None:
                DBOS.apply_schedules([{"schedule_name": "nightly", "workflow_fn": workflows.nightly, "schedule": self.cron}])
        self._monitor.start()

    def stop(self) -> None:
        """End the children and take no more work. What was under way stays unfinished in the database."""
        self._station.stopping.set()
        self._station.wake()
        end = time.monotonic() + 10
        while self._monitor.busy() and time.monotonic() < end:
            time.sleep(0.02)
        DBOS.destroy()
        self._monitor.stop()
        enter(None)

    def recover(self, executors: Sequence[str]) -> None:
        """Put the unfinished work of dead executors back into its queues; rows that a live one has taken since stay as they are."""
        for work in taken(executors) if executors else []:
            requeue(work)

    def sweep(self, live: set[str]) -> None:
        """Put work back into its queue that nobody does: see `jobs.strays`. live: the executors that live."""
        for stray in self._strays.among(taken(), live, time.monotonic()):
            if requeue(stray):
                log.warning("%s was left by %s: it is queued again", stray.workflow, stray.executor)


def _connecting(url: str) -> dict[str, Any]:
    """How a worker connects."""
    return {"connect_args": {"factory": WithoutFlush}} if is_sqlite(url) else {}
