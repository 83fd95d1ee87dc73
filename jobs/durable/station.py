"""What the workflows of this process work with: records, a bench, and what is known of the work under way."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from typing import Any, TypeVar

import sqlalchemy as sa

from jobs.durable.wire import workflow_id
from jobs.errors import StoreError
from jobs.graph import Node, graph
from jobs.monitor import Monitor, Watched
from jobs.outcome import CANCELLED, Order, Outcome
from jobs.plan import Plan
from jobs.points import reach
from jobs.records import Records
from jobs.stored_plans import load_plan
from jobs.strays import Strays
from jobs.work import Bench, carry_out
from reports.folder import State

PROGRESS_S = 1.0
AWAY_S = 1.0  # between two questions to a database that does not answer
Observer = Callable[[Node, State, dict[str, Any], str | None], None]
Answer = TypeVar("Answer")
log = logging.getLogger(__name__)


class Stopped(BaseException):
    """This execution ends: its workflow stays as it is and is taken up again, here or by another worker. Not recorded by DBOS."""


class Station:
    """Does nodes, and writes down how they ended. `news` is notified of every end; `stopping` is set when this worker ends."""

    def __init__(
        self, executor: str, records: Records, bench: Bench, monitor: Monitor, strays: Strays, *, poll_s: float,
        observer: Observer | None, nightly: Callable[[datetime], None],
    ) -> None:  # fmt: skip
        self.executor, self.records, self.bench, self.monitor, self.strays = executor, records, bench, monitor, strays
        self.poll_s, self.nightly = poll_s, nightly
        self.observer: Observer = observer or (lambda node, state, detail, error: None)
        self.news = threading.Condition()
        self.stopping = threading.Event()
        self._told: dict[str, float] = {}
        self._lock = threading.Lock()

    def wake(self) -> None:
        """Have those that wait for news look again."""
        with self.news:
            self.news.notify_all()

    def work(self, id: str, attempt: int, name: str) -> Outcome:
        """Do one node's work in this thread; raises Stopped when this worker ends first."""
        plan, order = self.plan_of(id)
        node = next(node for node in graph(plan) if node.id == name)
        watched = Watched(id, attempt, workflow_id(id, attempt, name), always=node.queue == "light")
        with self.monitor.watching(watched):
            self.patiently(lambda: self.records.start(id, attempt, name, self.executor, _facts(node)))
            self.observer(node, "running", {}, None)
            before = self.patiently(lambda: self.records.outcomes(id))
            after = {key: before[key] for key in node.after if key in before}
            bench = replace(
                self.bench, asked=lambda: self._asked(watched), progress=lambda detail: self._progress(id, node, detail)
            )
            reach(f"{node.kind} before work")
            if not watched.always and not self.patiently(lambda: self.records.wanted(id, attempt)):
                return CANCELLED
            return carry_out(plan, order, node, after, bench)

    def ended(self, id: str, attempt: int, name: str, outcome: Outcome) -> None:
        """Write a node's end down and wake those that wait for it."""
        node = next(node for node in graph(self.plan_of(id)[0]) if node.id == name)
        self.patiently(lambda: self.records.end(id, attempt, name, outcome, _facts(node)))
        self.observer(node, outcome.state, {}, outcome.error)
        self.wake()

    def plan_of(self, id: str) -> tuple[Plan, Order]:
        """Plan and order of an evaluation."""
        row = self.patiently(lambda: self.records.evaluation(id))
        order = Order.model_validate_json(row["order"])
        return load_plan(self.bench.artifacts, order.plan), order

    def patiently(self, ask: Callable[[], Answer]) -> Answer:
        """Ask the database until it answers: one that is full, locked or away holds the work up, and fails none of it."""
        while True:
            try:
                return ask()
            except (StoreError, sa.exc.SQLAlchemyError) as error:
                log.warning("waiting for the database: %s", error)
            if self.stopping.wait(AWAY_S):
                raise Stopped

    def _asked(self, watched: Watched) -> None:
        if self.stopping.is_set():
            raise Stopped
        if watched.reason is not None:
            raise watched.reason

    def _progress(self, id: str, node: Node, detail: dict[str, Any]) -> None:
        self.observer(node, "running", detail, None)
        now = time.monotonic()
        with self._lock:
            if now - self._told.get(id, -PROGRESS_S) < PROGRESS_S:
                return
            self._told[id] = now
        try:
            self.records.say(id, {"type": "progress", "node": node.id, "detail": detail, **_facts(node)})
        except StoreError as error:  # news that nobody hears fails no work
            log.warning("can't tell of progress: %s", error)


_here: Station | None = None


def enter(station: Station | None) -> None:
    """Make it the station of this process; None when its worker has ended."""
    global _here
    _here = station


def current() -> Station:
    """The station of this process; a workflow that finds none belongs to a worker that has ended."""
    if _here is None:
        raise Stopped
    return _here


def _facts(node: Node) -> dict[str, Any]:
    return {"kind": node.kind, "key": node.key}
