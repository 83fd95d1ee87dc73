"""The engine: evaluations and their nodes as DBOS workflows. The one module that knows DBOS.

An evaluation is a workflow on the queue `orchestra`: it enqueues nodes whose predecessors have ended, waits for the next one to
end, and so on to the report. A node is a workflow on `gl`, `reference` or `light` whose one long step does the work. A process that
dies loses nothing: its workflows go on after the last step that was recorded. A step may run twice, its result is recorded once.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from functools import lru_cache
from typing import Any, TypeVar

import sqlalchemy as sa
from dbos import DBOS, DBOSClient, Serializer, SetEnqueueOptions, SetWorkflowID
from dbos._dbos import _get_dbos_instance
from dbos._utils import INTERNAL_QUEUE_NAME
from pydantic import TypeAdapter

from jobs.artifacts import Artifacts
from jobs.database import IDLE_S, WithoutFlush, is_sqlite, prepare_file, readable_errors, with_driver
from jobs.errors import StoreError, TaskError, describe
from jobs.graph import REPORT, Node, graph, startable, withdrawable
from jobs.monitor import Monitor, Watched
from jobs.outcome import CANCELLED, Order, Outcome
from jobs.plan import Plan
from jobs.points import reach
from jobs.records import Records
from jobs.strays import PATIENCE_S, Stray, Strays
from jobs.values import from_text, to_text
from jobs.work import Bench, carry_out
from reports.folder import State

NAME = "luxmeter"
VERSION = "1"  # raised when the order of the workflows' steps changes; work of another version waits for a worker of that version
ORCHESTRA = "orchestra"
LIMITS = {"gl": 1, "reference": 1, "light": 2, ORCHESTRA: 64}  # workflows of a queue that one worker runs at once
DEATHS = 3  # a node is given up when its worker died this often
PROGRESS_S = 1.0
AWAY_S = 1.0  # between two questions to a database that does not answer
ENDED = ("SUCCESS", "ERROR", "CANCELLED", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
Observer = Callable[[Node, State, dict[str, Any], str | None], None]
Answer = TypeVar("Answer")
log = logging.getLogger(__name__)


class Json(Serializer):
    """How values lie in the database; see `jobs.values`."""

    def serialize(self, data: Any) -> str:
        """A value as text."""
        return to_text(data)

    def deserialize(self, serialized_data: str) -> Any:
        """The value of a text."""
        return from_text(serialized_data)

    def name(self) -> str:
        """Stands beside each value in the database."""
        return "luxmeter_json"


class Stopped(BaseException):
    """This execution ends: its workflow stays as it is and is taken up again, here or by another worker. Not recorded by DBOS."""


class Client:
    """What a process that does no work asks of the engine."""

    def __init__(self, url: str) -> None:
        self.url = url
        with readable_errors(url):
            prepare_file(url)
            DBOS.migrate(_address(url))
            self._client = DBOSClient(system_database_url=_address(url), serializer=Json(), application_name=NAME)

    def enqueue(self, id: str, attempt: int, priority: int, within: sa.Connection | None = None) -> None:
        """Have an attempt of an evaluation worked on; asking twice is asking once. within: this transaction."""
        options: Any = {
            "workflow_name": "evaluate", "queue_name": ORCHESTRA, "workflow_id": workflow_id(id, attempt), "app_version": VERSION,
            "priority": priority + 1,
        }  # fmt: skip
        with readable_errors(self.url):
            if within is None:
                self._client.enqueue(options, id, attempt)
            else:
                self._client.enqueue_in_transaction(within, options, id, attempt)

    def register(self, poll_s: float) -> None:
        """Make the queues known: an engine that finds them when it starts begins to take work at once, and else a second later."""
        with readable_errors(self.url):
            for name, limit in LIMITS.items():
                self._client.register_queue(name, worker_concurrency=limit, polling_interval_sec=poll_s)

    def forget(self, id: str) -> None:
        """Delete all workflows of an evaluation."""
        with readable_errors(self.url):
            known = self._client.list_workflows(workflow_id_prefix=f"{id}.", load_input=False, load_output=False)
            self._client.delete_workflows([status.workflow_id for status in known])

    def check(self) -> None:
        """Raises StoreError where the database can't be reached."""
        with readable_errors(self.url):
            self._client.check_connection()

    def close(self) -> None:
        """Close all connections."""
        self._client.destroy()


class Engine:
    """Runs workflows in this process, one engine a process. Between `start` and `stop`, work of the listed queues is taken.

    executor: name of this worker, unique among the live ones, and the same after a restart. idle_s: how long a transaction, or work
    that was taken, may stand still before others get on with it. nightly: called when `cron` says.
    """

    def __init__(
        self, url: str, executor: str, records: Records, bench: Bench, *, poll_s: float = 0.5, idle_s: float = IDLE_S,
        observer: Observer | None = None, nightly: Callable[[datetime], None], cron: str | None,
    ) -> None:  # fmt: skip
        self.url, self.executor, self.records, self.bench, self.poll_s = url, executor, records, bench, poll_s
        self.idle_s, self.nightly, self.cron = idle_s, nightly, cron
        self.observer: Observer = observer or (lambda node, state, detail, error: None)
        self.news = threading.Condition()
        self.stopping = threading.Event()
        self.strays = Strays(executor, min(idle_s, PATIENCE_S))
        self._told: dict[str, float] = {}
        self._lock = threading.Lock()
        self._monitor = Monitor(records, executor, _look)

    def start(self) -> None:
        """Take up what this executor left when it died, and begin to take work from the queues that a Client has registered."""
        global _engine
        with readable_errors(self.url):
            prepare_file(self.url)
            DBOS(
                config={
                    "name": NAME, "system_database_url": _address(self.url), "executor_id": self.executor, "serializer": Json(),
                    "application_version": VERSION, "log_level": "ERROR", "scheduler_polling_interval_sec": 2.0,
                    "notification_listener_polling_interval_sec": self.poll_s, "use_listen_notify": False,
                    "sys_db_idle_transaction_timeout_sec": self.idle_s, "db_engine_kwargs": _connecting(self.url),
                }
            )  # fmt: skip
            _engine = self
            DBOS.listen_queues(list(LIMITS))
            DBOS.launch()
            if self.cron is not None:
                DBOS.apply_schedules([{"schedule_name": "nightly", "workflow_fn": nightly, "schedule": self.cron}])
        self._monitor.start()

    def stop(self) -> None:
        """End the children and take no more work. What was under way stays unfinished in the database."""
        global _engine
        self.stopping.set()
        with self.news:
            self.news.notify_all()
        end = time.monotonic() + 10
        while self._monitor.busy() and time.monotonic() < end:
            time.sleep(0.02)
        DBOS.destroy()
        self._monitor.stop()
        _engine = None

    def recover(self, executors: Sequence[str]) -> None:
        """Put the unfinished work of dead executors back into its queues; rows that a live one has taken since stay as they are."""
        DBOS._recover_pending_workflows(list(executors))

    def sweep(self, live: set[str]) -> None:
        """Put work back into its queue that nobody does: see `jobs.strays`. live: the executors that live."""
        rows = DBOS.list_workflows(status="PENDING", app_version=VERSION, load_input=False, load_output=False)
        taken = [Stray(row.workflow_id, row.executor_id or "", row.dequeued_at) for row in rows]
        for stray in self.strays.among(taken, live, time.monotonic()):
            log.warning("%s was left by %s: it is queued again", stray.workflow, stray.executor)
            _requeue(stray)

    def work(self, id: str, attempt: int, name: str) -> Outcome:
        """Do one node's work in this thread; raises Stopped when this worker ends first."""
        plan, order = self.plan_of(id)
        node = next(node for node in graph(plan) if node.id == name)
        watched = Watched(id, attempt, workflow_id(id, attempt, name), always=node.queue == "light")
        with self._monitor.watching(watched):
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
        with self.news:
            self.news.notify_all()

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


_engine: Engine | None = None


def current() -> Engine:
    """The engine of this process; a workflow that finds none belongs to a worker that has ended."""
    if _engine is None:
        raise Stopped
    return _engine


def workflow_id(id: str, attempt: int, node: str | None = None) -> str:
    """Id of the workflow of an attempt, or of one of its nodes."""
    return f"{id}.{attempt}" if node is None else f"{id}.{attempt}/{node}"


@lru_cache(maxsize=8)
def load_plan(artifacts: Artifacts, name: str) -> Plan:
    """A plan from the store."""
    return TypeAdapter(Plan).validate_json(artifacts.get(name))


@contextmanager
def execution() -> Iterator[None]:
    """One execution of a workflow. What the database refuses to keep ends the execution; the workflow is taken up again."""
    with current().strays.at_work(str(DBOS.workflow_id)):
        try:
            yield
        except sa.exc.SQLAlchemyError as error:
            log.warning("can't go on with %s for now: %s", DBOS.workflow_id, error)
            raise Stopped from error


@DBOS.workflow(name="evaluate", max_recovery_attempts=1_000_000)
def evaluate(id: str, attempt: int) -> None:
    """One attempt at all nodes of an evaluation."""
    with execution():
        try:
            _evaluate(id, attempt)
        except sa.exc.SQLAlchemyError:
            raise
        except Exception as error:  # the workflow's edge: an evaluation that can't go on says why
            log.exception("evaluation %s ended early", id)
            conclude(id, attempt, describe(error))


def _evaluate(id: str, attempt: int) -> None:
    ended, priority = begin(id, attempt)
    plan, order = current().plan_of(id)
    done, running = set(ended), dict[str, Node]()
    waiting = [node for node in graph(plan) if node.id not in done]
    while waiting or running:
        for node in startable(waiting, done, running, order.references_first):
            waiting.remove(node)
            running[node.id] = node
            with SetWorkflowID(workflow_id(id, attempt, node.id)), SetEnqueueOptions(priority=priority + 1):
                DBOS.enqueue_workflow(node.queue, work, id, attempt, node.id)
        for name in await_end(id, attempt, sorted(running)):
            done.add(name)
            running.pop(name, None)
            waiting = [node for node in waiting if node.id != name]
    conclude(id, attempt, None)


@DBOS.step(name="begin")
def begin(id: str, attempt: int) -> tuple[list[str], int]:
    """Nodes that an earlier attempt has done, and the evaluation's priority."""
    engine = current()
    engine.patiently(lambda: engine.records.begin(id, attempt))
    rows = engine.patiently(lambda: engine.records.nodes(id, "node", "state"))
    row = engine.patiently(lambda: engine.records.evaluation(id))
    reach("evaluation begun")
    return sorted(node["node"] for node in rows if node["state"] == "done"), int(row["priority"])


@DBOS.step(name="await_end")
def await_end(id: str, attempt: int, running: list[str]) -> list[str]:
    """Wait until one of the running nodes has ended; all that have. When the evaluation is cancelled, also what was withdrawn."""
    engine = current()
    engine.patiently(lambda: engine.records.ready(id, attempt, running))
    reach("evaluation waiting")
    while True:
        if engine.stopping.is_set():
            raise Stopped
        if found := engine.patiently(lambda: _found(engine, id, attempt, running)):
            return found
        with engine.news:
            engine.news.wait(engine.poll_s)


def _found(engine: Engine, id: str, attempt: int, running: list[str]) -> list[str]:
    """Those of the running nodes that have ended, and what was withdrawn."""
    states = {row["node"]: row["state"] for row in engine.records.nodes(id, "node", "state")}
    found = [name for name in running if states[name] not in ("queued", "running")]
    if not engine.records.wanted(id, attempt):
        found += [name for name in _withdraw(engine, id, attempt, states) if name not in found]
    if not found:
        _bury(engine, id, attempt, running)
    return found


def _withdraw(engine: Engine, id: str, attempt: int, states: Mapping[str, str]) -> list[str]:
    """End nodes of a cancelled evaluation that no worker has begun; their names."""
    names = withdrawable(graph(engine.plan_of(id)[0]), states)
    if names:
        DBOS.cancel_workflows([workflow_id(id, attempt, name) for name in names])
        for name in names:
            engine.ended(id, attempt, name, CANCELLED)
    return names


def _bury(engine: Engine, id: str, attempt: int, running: list[str]) -> None:
    """End nodes whose workflow ended without an outcome: given up after too many deaths of its worker, or broken."""
    names = {workflow_id(id, attempt, name): name for name in running}
    found = DBOS.list_workflows(workflow_ids=list(names), status=[*ENDED], load_input=False, load_output=False)
    for status in found:
        if status.status == "MAX_RECOVERY_ATTEMPTS_EXCEEDED":
            error = TaskError(f"given up: the worker died each of the {DEATHS + 1} times this was tried", failure="poison")
        elif status.status == "SUCCESS":
            continue  # its end is being written down
        else:
            error = TaskError(f"ended as {status.status.lower()}: {status.error}", failure="error")
        engine.ended(id, attempt, names[status.workflow_id], Outcome.of(error))


@DBOS.step(name="conclude")
def conclude(id: str, attempt: int, error: str | None) -> None:
    """The attempt has ended: done when every node is, else failed."""
    engine = current()
    rows = engine.patiently(lambda: engine.records.nodes(id, "node", "state"))
    states = {row["node"]: row["state"] for row in rows}
    reach("evaluation before conclude")
    failed = error is not None or any(state != "done" for state in states.values()) or bool(engine.plan_of(id)[0].refused)
    if error is None and states.get(REPORT) == "failed":
        error = f"report: {engine.patiently(lambda: engine.records.outcomes(id))[REPORT].error}"
    engine.patiently(lambda: engine.records.finish(id, attempt, "failed" if failed else "done", error))
    with engine.news:
        engine.news.notify_all()


@DBOS.workflow(name="work", max_recovery_attempts=DEATHS)
def work(id: str, attempt: int, name: str) -> None:
    """One node: do it, then write down how it ended."""
    with execution():
        settle(id, attempt, name, do(id, attempt, name))


@DBOS.step(name="do")
def do(id: str, attempt: int, name: str) -> dict[str, Any]:
    """The outcome of a node's work, recorded once, by the execution that owns the workflow."""
    engine = current()
    outcome = engine.work(id, attempt, name)
    reach(f"{name.partition(':')[0]} after work")
    return outcome.model_dump(mode="json")


@DBOS.step(name="settle")
def settle(id: str, attempt: int, name: str, outcome: dict[str, Any]) -> None:
    """Write the recorded outcome into luxmeter's own tables."""
    reach("node before settle")
    current().ended(id, attempt, name, Outcome.model_validate(outcome))
    reach("node after settle")


@DBOS.workflow(name="nightly")
def nightly(scheduled: datetime, context: Any) -> None:
    """What the worker does every night."""
    with execution():
        night(scheduled)


@DBOS.step(name="night")
def night(scheduled: datetime) -> None:
    """Call the worker's nightly function."""
    current().nightly(scheduled)


def _look(workflows: Sequence[str]) -> dict[str, Any]:
    """What the database says of workflows, by their id."""
    rows = DBOS.list_workflows(workflow_ids=list(workflows), load_input=False, load_output=False)
    return {row.workflow_id: row for row in rows}


def _requeue(stray: Stray) -> None:
    """Put one workflow back into its queue, unless another executor has taken it since."""
    _get_dbos_instance()._sys_db.reenqueue_for_recovery(stray.workflow, [stray.executor], INTERNAL_QUEUE_NAME)


def _facts(node: Node) -> dict[str, Any]:
    return {"kind": node.kind, "key": node.key}


def _address(url: str) -> str:
    """The URL as DBOS takes it."""
    return url if is_sqlite(url) else with_driver(url)


def _connecting(url: str) -> dict[str, Any]:
    """How a worker connects."""
    return {"connect_args": {"factory": WithoutFlush}} if is_sqlite(url) else {}
