"""The engine: evaluations and their nodes as DBOS workflows. The one module that knows DBOS.

An evaluation is a workflow on the queue `orchestra`: it enqueues nodes whose predecessors have ended, waits for the next one to
end, and so on to the report. A node is a workflow on `gl`, `reference` or `light` whose one long step does the work. A process that
dies loses nothing: its workflows go on after the last step that was recorded. A step may run twice, its result is recorded once.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from functools import lru_cache
from typing import Any

import sqlalchemy as sa
from dbos import DBOS, DBOSClient, Serializer, SetEnqueueOptions, SetWorkflowID
from pydantic import TypeAdapter

from jobs.artifacts import Artifacts
from jobs.database import is_sqlite, prepare_file, readable_errors, with_driver
from jobs.errors import StoreError, TaskError, describe
from jobs.graph import REPORT, Node, graph
from jobs.outcome import CANCELLED, Order, Outcome
from jobs.plan import Plan
from jobs.points import reach
from jobs.records import Records
from jobs.work import Bench, carry_out
from reports.folder import State

NAME = "luxmeter"
VERSION = "1"  # raised when the order of the workflows' steps changes; work of another version waits for a worker of that version
ORCHESTRA = "orchestra"
LIMITS = {"gl": 1, "reference": 1, "light": 2, ORCHESTRA: 64}  # workflows of a queue that one worker runs at once
WINDOW = 32  # nodes of one evaluation that wait in a queue or run
DEATHS = 3  # a node is given up when its worker died this often
ASK_S = 0.25
PROGRESS_S = 1.0
ENDED = ("SUCCESS", "ERROR", "CANCELLED", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
Observer = Callable[[Node, State, dict[str, Any], str | None], None]
log = logging.getLogger(__name__)


class Json(Serializer):
    """Values in the database are JSON: whoever can write there must not thereby run code in the workers."""

    def serialize(self, data: Any) -> str:
        """Exceptions become their description, times ISO 8601."""
        return json.dumps(data, default=_tagged)

    def deserialize(self, serialized_data: str) -> Any:
        """The inverse; an exception comes back as a RuntimeError with its description."""
        return json.loads(serialized_data, object_hook=_untagged)

    def name(self) -> str:
        """Stands beside each value in the database."""
        return "luxmeter_json"


def _tagged(value: Any) -> dict[str, str]:
    if isinstance(value, datetime):
        return {"__time__": value.isoformat()}
    if isinstance(value, BaseException):
        return {"__error__": f"{type(value).__name__}: {value}"}
    raise TypeError(f"{type(value).__name__} is not kept in the database")


def _untagged(value: dict[str, Any]) -> Any:
    if set(value) == {"__time__"}:
        return datetime.fromisoformat(value["__time__"])
    return RuntimeError(value["__error__"]) if set(value) == {"__error__"} else value


class Stopped(BaseException):
    """This worker ends: the workflow under way stays as it is and is taken up by the next worker. Not recorded by DBOS."""


class Client:
    """What a process that does no work asks of the engine."""

    def __init__(self, url: str) -> None:
        self.url = url
        with readable_errors(url):
            prepare_file(url)
            DBOS.migrate(_address(url))
            self._client = DBOSClient(system_database_url=_address(url), serializer=Json(), application_name=NAME)

    def enqueue(self, id: str, attempt: int, priority: int) -> None:
        """Have an attempt of an evaluation worked on; asking twice is asking once."""
        options: Any = {
            "workflow_name": "evaluate", "queue_name": ORCHESTRA, "workflow_id": workflow_id(id, attempt), "app_version": VERSION,
            "priority": priority + 1,
        }  # fmt: skip
        with readable_errors(self.url):
            self._client.enqueue(options, id, attempt)

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

    executor: name of this worker, unique among the live ones, and the same after a restart. nightly: called when `cron` says.
    """

    def __init__(
        self, url: str, executor: str, records: Records, bench: Bench, *, poll_s: float = 0.5, observer: Observer | None = None,
        nightly: Callable[[datetime], None], cron: str | None,
    ) -> None:  # fmt: skip
        self.url, self.executor, self.records, self.bench, self.poll_s = url, executor, records, bench, poll_s
        self.nightly, self.cron = nightly, cron
        self.observer: Observer = observer or (lambda node, state, detail, error: None)
        self.news = threading.Condition()
        self.stopping = threading.Event()
        self._watched: dict[str, Watched] = {}
        self._told: dict[str, float] = {}
        self._lock = threading.Lock()
        self._monitor = threading.Thread(target=self._watch, name="luxmeter-monitor", daemon=True)

    def start(self) -> None:
        """Take up what this executor left when it died, and begin to take work."""
        global _engine
        with readable_errors(self.url):
            prepare_file(self.url)
            DBOS(
                config={
                    "name": NAME, "system_database_url": _address(self.url), "executor_id": self.executor, "serializer": Json(),
                    "application_version": VERSION, "log_level": "ERROR", "scheduler_polling_interval_sec": 2.0,
                    "notification_listener_polling_interval_sec": self.poll_s, "use_listen_notify": False,
                }
            )  # fmt: skip
            _engine = self
            DBOS.listen_queues(list(LIMITS))
            DBOS.launch()
            for name, limit in LIMITS.items():
                DBOS.register_queue(name, worker_concurrency=limit, polling_interval_sec=self.poll_s, on_conflict="always_update")
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
        while self._watched and time.monotonic() < end:
            time.sleep(0.02)
        DBOS.destroy()
        self._monitor.join()
        _engine = None

    def recover(self, executors: Sequence[str]) -> None:
        """Put the unfinished work of dead executors back into its queues; rows that a live one has taken since stay as they are."""
        DBOS._recover_pending_workflows(list(executors))

    def work(self, id: str, attempt: int, name: str) -> Outcome:
        """Do one node's work in this thread; raises Stopped when this worker ends first."""
        plan, order = self.plan_of(id)
        node = next(node for node in graph(plan) if node.id == name)
        watched = Watched(id, attempt, workflow_id(id, attempt, name), always=node.queue == "light")
        with self._lock:
            self._watched[watched.workflow] = watched
        try:
            self.records.start(id, attempt, name, self.executor, _facts(node))
            self.observer(node, "running", {}, None)
            before = self.records.outcomes(id)
            after = {key: before[key] for key in node.after if key in before}
            bench = replace(
                self.bench, asked=lambda: self._asked(watched), progress=lambda detail: self._progress(id, node, detail)
            )
            reach(f"{node.kind} before work")
            if not watched.always and not self.records.wanted(id, attempt):
                return CANCELLED
            return carry_out(plan, order, node, after, bench)
        finally:
            with self._lock:
                self._watched.pop(watched.workflow, None)

    def ended(self, id: str, attempt: int, name: str, outcome: Outcome) -> None:
        """Write a node's end down and wake those that wait for it."""
        node = next(node for node in graph(self.plan_of(id)[0]) if node.id == name)
        self.records.end(id, attempt, name, outcome, _facts(node))
        self.observer(node, outcome.state, {}, outcome.error)
        with self.news:
            self.news.notify_all()

    def plan_of(self, id: str) -> tuple[Plan, Order]:
        """Plan and order of an evaluation."""
        order = Order.model_validate_json(self.records.evaluation(id)["order"])
        return load_plan(self.bench.artifacts, order.plan), order

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
        self.records.say(id, {"type": "progress", "node": node.id, "detail": detail, **_facts(node)})

    def _watch(self) -> None:
        """Ask the database again and again whether the work of this process is still wanted and still ours."""
        while not self.stopping.wait(ASK_S):
            with self._lock:
                watched = list(self._watched.values())
            if not watched:
                continue
            try:
                self._look_at(watched)
            except (StoreError, sa.exc.SQLAlchemyError) as error:  # a database that is away for a while is no reason to stop
                log.warning("can't ask whether work is still wanted: %s", error)

    def _look_at(self, watched: Sequence[Watched]) -> None:
        known = DBOS.list_workflows(workflow_ids=[w.workflow for w in watched], load_input=False, load_output=False)
        rows = {status.workflow_id: status for status in known}
        for one in watched:
            row = rows.get(one.workflow)
            if (
                row is None
                or row.status != "PENDING"
                or row.executor_id != self.executor
                or one.since not in (None, row.dequeued_at)
            ):
                one.reason = TaskError("another worker has taken this over", failure="abandoned")
            else:
                one.since = row.dequeued_at
            if not one.always and not self.records.wanted(one.evaluation, one.attempt):
                one.reason = TaskError("cancelled", failure="cancelled")


class Watched:
    """Work under way in this process, and why it is to stop, if it is. always: goes on although its evaluation is cancelled."""

    def __init__(self, evaluation: str, attempt: int, workflow: str, *, always: bool) -> None:
        self.evaluation, self.attempt, self.workflow, self.always = evaluation, attempt, workflow, always
        self.since: int | None = None
        self.reason: TaskError | None = None


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


@DBOS.workflow(name="evaluate", max_recovery_attempts=1_000_000)
def evaluate(id: str, attempt: int) -> None:
    """One attempt at all nodes of an evaluation."""
    try:
        _evaluate(id, attempt)
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


def startable(waiting: Sequence[Node], done: set[str], running: Mapping[str, Node], references_first: bool) -> list[Node]:
    """Nodes to enqueue now: all light ones that can start, and others while there is room in the window."""
    ready = [node for node in waiting if done.issuperset(node.after)]
    room = WINDOW - sum(node.queue != "light" for node in running.values())
    heavy = [node for node in ready if node.queue != "light"]
    if references_first and any(node.queue == "reference" for node in (*waiting, *running.values())):
        heavy = [node for node in heavy if node.queue == "reference"]
    return [node for node in ready if node.queue == "light"] + heavy[: max(room, 0)]


@DBOS.step(name="begin")
def begin(id: str, attempt: int) -> tuple[list[str], int]:
    """Nodes that an earlier attempt has done, and the evaluation's priority."""
    records = current().records
    records.begin(id, attempt)
    done = [row["node"] for row in records.nodes(id, "node", "state") if row["state"] == "done"]
    reach("evaluation begun")
    return sorted(done), int(records.evaluation(id)["priority"])


@DBOS.step(name="await_end")
def await_end(id: str, attempt: int, running: list[str]) -> list[str]:
    """Wait until one of the running nodes has ended; all that have. When the evaluation is cancelled, also what was withdrawn."""
    engine = current()
    engine.records.ready(id, attempt, running)
    reach("evaluation waiting")
    while True:
        if engine.stopping.is_set():
            raise Stopped
        states = {row["node"]: row["state"] for row in engine.records.nodes(id, "node", "state")}
        found = [name for name in running if states[name] not in ("queued", "running")]
        if not engine.records.wanted(id, attempt):
            found += [name for name in _withdraw(engine, id, attempt, states) if name not in found]
        if found:
            return found
        _bury(engine, id, attempt, running)
        with engine.news:
            engine.news.wait(engine.poll_s)


def _withdraw(engine: Engine, id: str, attempt: int, states: Mapping[str, str]) -> list[str]:
    """End nodes of a cancelled evaluation that no worker has begun; their names."""
    names = withdrawable(graph(engine.plan_of(id)[0]), states)
    if names:
        DBOS.cancel_workflows([workflow_id(id, attempt, name) for name in names])
        for name in names:
            engine.ended(id, attempt, name, CANCELLED)
    return names


def withdrawable(nodes: Sequence[Node], states: Mapping[str, str]) -> list[str]:
    """Nodes of a cancelled evaluation that needn't be done: what renders was done is still compared, and the report written."""
    lost = {node.id for node in nodes if node.queue != "light" and states[node.id] != "done"}
    lost |= {node.id for node in nodes if node.id != REPORT and not lost.isdisjoint(node.after)}
    return [node.id for node in nodes if node.id in lost and states[node.id] == "queued"]


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
    states = {row["node"]: row["state"] for row in engine.records.nodes(id, "node", "state")}
    reach("evaluation before conclude")
    failed = error is not None or any(state != "done" for state in states.values()) or bool(engine.plan_of(id)[0].refused)
    if error is None and states.get(REPORT) == "failed":
        error = f"report: {engine.records.outcomes(id)[REPORT].error}"
    engine.records.finish(id, attempt, "failed" if failed else "done", error)
    with engine.news:
        engine.news.notify_all()


@DBOS.workflow(name="work", max_recovery_attempts=DEATHS)
def work(id: str, attempt: int, name: str) -> None:
    """One node: do it, then write down how it ended."""
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
    night(scheduled)


@DBOS.step(name="night")
def night(scheduled: datetime) -> None:
    """Call the worker's nightly function."""
    current().nightly(scheduled)


def _facts(node: Node) -> dict[str, Any]:
    return {"kind": node.kind, "key": node.key}


def _address(url: str) -> str:
    """The URL as DBOS takes it."""
    return url if is_sqlite(url) else with_driver(url)
