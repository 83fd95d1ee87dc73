"""An evaluation as a workflow, and each of its nodes as one.

An evaluation is a workflow on the queue `orchestra`: it enqueues nodes whose predecessors have ended, waits for the next one to
end, and so on to the report. A node is a workflow on `gl`, `reference` or `light` whose one long step does the work. A process that
dies loses nothing: its workflows go on after the last step that was recorded. A step may run twice, its result is recorded once.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from typing import Any

import sqlalchemy as sa
from dbos import DBOS, SetEnqueueOptions, SetWorkflowID

from jobs.durable.station import Station, Stopped, current
from jobs.durable.wire import workflow_id
from jobs.errors import TaskError, describe
from jobs.graph import REPORT, Node, graph, startable, withdrawable
from jobs.outcome import CANCELLED, Outcome
from jobs.points import reach

DEATHS = 3  # a node is given up when its worker died this often
ENDED = ("SUCCESS", "ERROR", "CANCELLED", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
log = logging.getLogger(__name__)


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
    here = current()
    here.patiently(lambda: here.records.begin(id, attempt))
    rows = here.patiently(lambda: here.records.nodes(id, "node", "state"))
    row = here.patiently(lambda: here.records.evaluation(id))
    reach("evaluation begun")
    return sorted(node["node"] for node in rows if node["state"] == "done"), int(row["priority"])


@DBOS.step(name="await_end")
def await_end(id: str, attempt: int, running: list[str]) -> list[str]:
    """Wait until one of the running nodes has ended; all that have. When the evaluation is cancelled, also what was withdrawn."""
    here = current()
    here.patiently(lambda: here.records.ready(id, attempt, running))
    reach("evaluation waiting")
    while True:
        if here.stopping.is_set():
            raise Stopped
        if found := here.patiently(lambda: _found(here, id, attempt, running)):
            return found
        with here.news:
            here.news.wait(here.poll_s)


def _found(here: Station, id: str, attempt: int, running: list[str]) -> list[str]:
    """Those of the running nodes that have ended, and what was withdrawn."""
    states = {row["node"]: row["state"] for row in here.records.nodes(id, "node", "state")}
    found = [name for name in running if states[name] not in ("queued", "running")]
    if not here.records.wanted(id, attempt):
        found += [name for name in _withdraw(here, id, attempt, states) if name not in found]
    if not found:
        _bury(here, id, attempt, running)
    return found


def _withdraw(here: Station, id: str, attempt: int, states: Mapping[str, str]) -> list[str]:
    """End nodes of a cancelled evaluation that no worker has begun; their names."""
    names = withdrawable(graph(here.plan_of(id)[0]), states)
    if names:
        DBOS.cancel_workflows([workflow_id(id, attempt, name) for name in names])
        for name in names:
            here.ended(id, attempt, name, CANCELLED)
    return names


def _bury(here: Station, id: str, attempt: int, running: list[str]) -> None:
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
        here.ended(id, attempt, names[status.workflow_id], Outcome.of(error))


@DBOS.step(name="conclude")
def conclude(id: str, attempt: int, error: str | None) -> None:
    """The attempt has ended: done when every node is, else failed."""
    here = current()
    rows = here.patiently(lambda: here.records.nodes(id, "node", "state"))
    states = {row["node"]: row["state"] for row in rows}
    reach("evaluation before conclude")
    failed = error is not None or any(state != "done" for state in states.values()) or bool(here.plan_of(id)[0].refused)
    if error is None and states.get(REPORT) == "failed":
        error = f"report: {here.patiently(lambda: here.records.outcomes(id))[REPORT].error}"
    here.patiently(lambda: here.records.finish(id, attempt, "failed" if failed else "done", error))
    here.wake()


@DBOS.workflow(name="work", max_recovery_attempts=DEATHS)
def work(id: str, attempt: int, name: str) -> None:
    """One node: do it, then write down how it ended."""
    with execution():
        settle(id, attempt, name, do(id, attempt, name))


@DBOS.step(name="do")
def do(id: str, attempt: int, name: str) -> dict[str, Any]:
    """The outcome of a node's work, recorded once, by the execution that owns the workflow."""
    here = current()
    outcome = here.work(id, attempt, name)
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
