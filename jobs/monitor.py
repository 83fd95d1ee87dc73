"""Is the work under way in this process still wanted, and still ours? Asked again and again while it goes on."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa

from jobs.errors import StoreError, TaskError
from jobs.records import Records

ASK_S = 0.25
Look = Callable[[Sequence[str]], Mapping[str, Any]]
log = logging.getLogger(__name__)


class Watched:
    """Work under way in this process, and why it is to stop, if it is. always: goes on although its evaluation is cancelled."""

    def __init__(self, evaluation: str, attempt: int, workflow: str, *, always: bool) -> None:
        self.evaluation, self.attempt, self.workflow, self.always = evaluation, attempt, workflow, always
        self.since: int | None = None
        self.reason: TaskError | None = None


class Monitor:
    """Watches work from a thread of its own. look: what the engine knows of workflows; executor: who we are there."""

    def __init__(self, records: Records, executor: str, look: Look) -> None:
        self._records, self._executor, self._look = records, executor, look
        self._watched: list[Watched] = []
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="luxmeter-monitor", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def stop(self) -> None:
        """Ask no more."""
        self._stopping.set()
        self._thread.join()

    def busy(self) -> bool:
        """Whether anything is watched."""
        with self._lock:
            return bool(self._watched)

    @contextmanager
    def watching(self, work: Watched) -> Iterator[None]:
        """Watch a piece of work while the block runs."""
        with self._lock:
            self._watched.append(work)
        try:
            yield
        finally:
            with self._lock:
                self._watched.remove(work)

    def _run(self) -> None:
        while not self._stopping.wait(ASK_S):
            with self._lock:
                watched = list(self._watched)
            if not watched:
                continue
            try:
                self._ask(watched)
            except (StoreError, sa.exc.SQLAlchemyError) as error:  # a database that is away for a while is no reason to stop
                log.warning("can't ask whether work is still wanted: %s", error)
            except Exception:  # the thread's edge: nothing could be cancelled any more
                log.exception("can't ask whether work is still wanted")

    def _ask(self, watched: Sequence[Watched]) -> None:
        rows = self._look([one.workflow for one in watched])
        for one in watched:
            row = rows.get(one.workflow)
            ours = row is not None and row.status == "PENDING" and row.executor_id == self._executor
            if row is None or not ours or one.since not in (None, row.dequeued_at):
                one.reason = TaskError("another worker has taken this over", failure="abandoned")
            else:
                one.since = row.dequeued_at
            if not one.always and not self._records.wanted(one.evaluation, one.attempt):
                one.reason = TaskError("cancelled", failure="cancelled")
