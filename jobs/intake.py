"""How submissions reach the database: those of one process that wait together share one transaction.

A commit that outlives a power cut costs a flush to disk, and on SQLite one process writes at a time. Under load the first that
waits therefore writes for all that wait with it; each is told once that transaction is kept.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sqlalchemy as sa

from jobs.graph import Node
from jobs.outcome import Order
from jobs.points import reach
from jobs.records import Records


@dataclass
class Submission:
    """An evaluation to be. nodes: (node, method); created: seconds since 1970. new, error: what became of it, once `written`."""

    order: Order
    request: str
    priority: int
    nodes: Sequence[tuple[Node, str | None]]
    created: float
    written: bool = False
    new: bool = False
    error: BaseException | None = None


class Intake:
    """Writes submissions and has them worked on: `enqueue` is called in their transaction, so both are kept or neither."""

    def __init__(self, records: Records, enqueue: Callable[[sa.Connection, Submission], None]) -> None:
        self._records, self._enqueue = records, enqueue
        self._waiting: list[Submission] = []
        self._waiting_changes = threading.Lock()
        self._turn = threading.Lock()

    def add(self, submission: Submission) -> bool:
        """Keep a submission unless its evaluation is there already; whether it was added. Raises StoreError."""
        with self._waiting_changes:
            self._waiting.append(submission)
        with self._turn:
            if not submission.written:
                self._write()
        if submission.error is not None:
            raise submission.error
        return submission.new

    def _write(self) -> None:
        with self._waiting_changes:
            together, self._waiting = self._waiting, []
        error: BaseException | None = None
        try:
            with self._records.urgent() as connection:
                # in one order everywhere: two services that add the same evaluations must not wait for each other
                for submission in sorted(together, key=lambda s: s.order.evaluation):
                    self._add(connection, submission)
        except BaseException as cause:  # each thread that waits raises it in its own place
            error = cause
        for submission in together:
            submission.written, submission.error = True, error

    def _add(self, connection: sa.Connection, submission: Submission) -> None:
        s = submission
        submission.new = self._records.add_within(connection, s.order, s.request, s.priority, s.nodes, s.created)
        if submission.new:
            reach("submit before enqueue")
            self._enqueue(connection, submission)
