"""Carry out a plan on the embedded queue: an SQLite file in the data folder, and a worker in this process.

The same engine as the service's, for one evaluation. The file is removed when the evaluation has ended; after a crash the same call
finds it and goes on where that one was.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jobs.folder import write_folder
from jobs.graph import Node
from jobs.machine import only_one
from jobs.outcome import Order
from jobs.plan import Plan
from jobs.process import run_task
from jobs.store import Store
from jobs.work import Runner
from reports.folder import Evaluation, State

if TYPE_CHECKING:
    from jobs.queue import JobQueue

POLL_S = 0.1


@dataclass(frozen=True)
class Event:
    """Something happened to a node: it started, told its progress (`detail`), or ended, with an error or without."""

    node: Node
    state: State
    detail: dict[str, Any] = field(default_factory=dict)
    error: str | None = None


@dataclass(frozen=True)
class Options:
    """How to carry a plan out. wall_s, memory_bytes: of each child; repeats: renders of a frame; max_seconds: of a reference.

    Renders are timed anew unless `reuse` allows those of the artefact store.
    """

    command: str = ""
    repeats: int = 1
    wall_s: float | None = None
    memory_bytes: int | None = None
    max_seconds: float | None = None
    reuse: bool = False
    store: Store = field(default_factory=Store)
    runner: Runner = run_task

    @property
    def how(self) -> dict[str, Any]:
        """What an Order says besides the plan."""
        names = ("command", "repeats", "wall_s", "memory_bytes", "max_seconds", "reuse")
        return {name: getattr(self, name) for name in names} | {"references_first": True}


def evaluate(plan: Plan, folder: Path, options: Options | None = None, notify: Callable[[Event], None] | None = None) -> Evaluation:
    """Do all of the plan's work and write the report into `folder`. A failing cell holds its error and leaves the others alone.

    Images and results are written even where the report fails: `index.html` is missing then, and `logs/` says why.

    An interrupt (Ctrl-C) ends the children, marks what was not done as cancelled, and the report is written all the same.
    """
    from jobs.queue import JobQueue
    from jobs.worker import Worker

    options = options or Options()
    tell = notify or (lambda event: None)
    with _own_database(plan, options) as path:
        url = f"sqlite:///{path}"
        queue = JobQueue(url, options.store.artifacts)
        worker = Worker(
            url, options.store.artifacts, poll_s=POLL_S, home=options.store, runner=options.runner, wall_s=None, cron=None,
            observer=lambda node, state, detail, error: tell(Event(node, state, detail, error)),
        )  # fmt: skip
        try:
            with worker.working():
                _wait(queue, plan, options)
            order = Order.model_validate_json(queue.records.evaluation(plan.id)["order"])
            found = write_folder(plan, order, queue.records.outcomes(plan.id), queue.artifacts, folder)
        finally:
            queue.close()
        _remove(path)
    return found


def _wait(queue: JobQueue, plan: Plan, options: Options) -> None:
    """Submit the plan, or take up what an earlier process left of it, and wait for its end; an interrupt cancels it."""
    status = queue.submit_plan(plan, plan.request.priority, queue.order(plan, plan.id, **options.how))
    if status.state in ("failed", "cancelled"):
        queue.retry(plan.id)
    while True:
        try:
            while queue.records.evaluation(plan.id)["finished"] is None:
                time.sleep(POLL_S)
            return
        except KeyboardInterrupt:
            queue.cancel(plan.id)


@contextmanager
def _own_database(plan: Plan, options: Options) -> Iterator[Path]:
    """A database that no other live process uses: that of an equal call that was killed, or a new one."""
    body = json.dumps([plan.id, options.how | {"command": ""}])
    name = hashlib.sha256(body.encode()).hexdigest()[:16]
    for twin in itertools.count():
        path = options.store.home.resolve() / "runs" / f"{name}-{twin}.sqlite"
        with only_one(path.with_suffix(".lock")) as ours:
            if ours:
                yield path
                return


def _remove(database: Path) -> None:
    for suffix in ("", "-wal", "-shm"):
        database.with_name(database.name + suffix).unlink(missing_ok=True)
