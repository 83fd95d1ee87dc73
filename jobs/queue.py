"""The queue as its users see it: submit an evaluation, ask for its state, events, report and results, cancel it, try it again.

queue = JobQueue()                          # LUXMETER_DATABASE and LUXMETER_STORE, or files in LUXMETER_HOME
status = queue.submit(request)              # at once; the same request again is the same evaluation
Worker().run(threading.Event())             # in another process: does the work
"""

from __future__ import annotations

import base64
import json
import time
import uuid
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from jobs.artifacts import Artifacts
from jobs.durable.client import Client
from jobs.folder import cells_of, files_of, write_folder
from jobs.graph import REPORT, graph
from jobs.intake import Intake, Submission
from jobs.outcome import Order
from jobs.plan import Plan, plan
from jobs.points import reach
from jobs.records import LIVE, Records, Row
from jobs.request import EvaluationRequest
from jobs.store import Store
from jobs.stored_plans import load_plan, store_plan
from jobs.worker import Worker
from reports.folder import Cell, State
from reports.results import Result

__all__ = ["JobQueue", "Status", "Worker"]


@dataclass(frozen=True)
class Status:
    """An evaluation now. created, finished: ISO 8601; progress: nodes `done` of `total`; error: of the evaluation as a whole."""

    id: str
    state: State
    created: str
    finished: str | None
    request: EvaluationRequest
    cells: list[Cell] = field(default_factory=list)
    progress: dict[str, int] = field(default_factory=dict)
    error: str | None = None


Events = list[dict[str, Any]]
Results = list[Result]


class JobQueue:
    """Evaluations in a database and an artefact store. Methods that take an id raise KeyError where there is no such evaluation.

    database: `sqlite:////path/file` or `postgresql://…`; store: a folder or an fsspec URL. Raises StoreError where either fails.
    """

    def __init__(self, database: str | None = None, store: str | None = None) -> None:
        home = Store()
        self.artifacts = Artifacts(store or home.artifacts)
        self.records = Records(database or home.database)
        self._client = Client(self.records.url)
        self._intake = Intake(
            self.records, lambda connection, s: self._client.enqueue(s.order.evaluation, 1, s.priority, connection)
        )

    def close(self) -> None:
        """Close all connections."""
        self._client.close()
        self.records.close()

    def submit(self, request: EvaluationRequest, priority: int = 5) -> Status:
        """Have a request evaluated; it is kept once this returns. 0 is the most urgent priority, 9 the least.

        The id is the hash of request and code: asking again answers the evaluation there is, whatever became of it.
        """
        planned = plan(request)
        return self.submit_plan(planned, priority, self.order(planned, planned.id))

    def order(self, planned: Plan, id: str, **how: Any) -> Order:
        """How to carry a plan out as evaluation `id`; stores the plan."""
        stored = store_plan(self.artifacts, planned)
        created = datetime.now(UTC).isoformat(timespec="seconds")
        return Order(evaluation=id, plan=stored, run=uuid.uuid4().hex[:16], created=created, **how)

    def submit_plan(self, planned: Plan, priority: int, order: Order) -> Status:
        """Have a plan carried out."""
        nodes = [(node, planned.renders[node.key].method if node.kind == "render" else None) for node in graph(planned)]
        request = planned.request.model_copy(update={"priority": priority})
        reach("submit before record")
        created = time.time()
        new = self._intake.add(Submission(order, request.model_dump_json(), priority, nodes, created))
        reach("submit after enqueue")
        if not new:
            return self.status(order.evaluation)
        cells, progress = cells_of(planned, {}, {}), {"done": 0, "total": len(nodes)}
        return Status(order.evaluation, "queued", _iso(created), None, request, cells, progress)

    def status(self, id: str) -> Status:
        """State, progress and cells."""
        row = self.records.evaluation(id)
        nodes = self.records.nodes(id, "node", "state", "error")
        states: dict[str, State] = {n["node"]: n["state"] for n in nodes}
        errors = {n["node"]: n["error"] for n in nodes if n["error"] is not None}
        cells = cells_of(self._plan(row), states, errors)
        if row["state"] == "cancelled":
            for cell in cells:
                if cell.state in LIVE:
                    cell.state, cell.error = "cancelled", "cancelled"
        return _status(row, sum(state not in LIVE for state in states.values()), cells)

    def list(self, state: str | None = None, limit: int = 50, cursor: str | None = None) -> tuple[list[Status], str | None]:
        """Evaluations without their cells, the newest first, and the cursor of the next page. Raises ValueError for a bad one."""
        rows = self.records.page(state, limit + 1, None if cursor is None else _from_cursor(cursor))
        done = self.records.done_counts([row["id"] for row in rows[:limit]])
        found = [_status(row, done.get(row["id"], 0), []) for row in rows[:limit]]
        return found, _to_cursor(rows[limit - 1]) if len(rows) > limit else None

    def events(self, id: str, after: int = 0) -> Events:
        """What happened since event number `after`, each with `seq`, `time` and `type` (evaluation, node or progress)."""
        return self.records.events(id, after)

    def cancel(self, id: str) -> Status:
        """Cancel what is queued and running; the report of what is done is still written. An evaluation that has ended stays."""
        self.records.evaluation(id)
        self.records.cancel(id)
        return self.status(id)

    def retry(self, id: str) -> Status:
        """Try a failed or cancelled evaluation again: what is done stays, the rest is done anew. Others stay as they are."""
        outcomes = self.records.outcomes(id)
        lost = [name for name, outcome in outcomes.items() if not all(self.artifacts.has(h) for h in outcome.files.values())]
        self.records.evaluation(id)
        if self.records.again(id, lost) is not None:
            self._enqueue(id)
        return self.status(id)

    def report_file(self, id: str, path: str) -> bytes | None:
        """A file of the evaluation's folder (`index.html`, `assets/…`, `results.csv`, `images/…`); None where there is none yet."""
        name = files_of(self._plan(self.records.evaluation(id)), self.records.outcomes(id)).get(path)
        return None if name is None else self.artifacts.get(name)

    def export(self, id: str, folder: Path) -> None:
        """Write what the evaluation has so far as an evaluation folder, without its report."""
        row = self.records.evaluation(id)
        outcomes = {name: outcome for name, outcome in self.records.outcomes(id).items() if name != REPORT}
        write_folder(self._plan(row), Order.model_validate_json(row["order"]), outcomes, self.artifacts, folder)

    def results(self, id: str) -> Results:
        """Results of the cells that are done, in the plan's order."""
        planned = self._plan(self.records.evaluation(id))
        files = files_of(planned, self.records.outcomes(id))
        done = [cell for cell in self.status(id).cells if cell.state == "done"]
        return [Result.model_validate_json(self.artifacts.get(files[f"results/{cell.id}.json"])) for cell in done]

    def artifact(self, hash: str) -> tuple[BinaryIO, int] | None:
        """An open binary file and its size in bytes, None where there is no such artefact."""
        return self.artifacts.open(hash)

    def stats(self) -> dict[str, Any]:
        """State of the whole, for gauges.

        queues: queued and running nodes and seconds the oldest waits (`queued`, `running`, `oldest_s`) by queue; failures: by kind;
        seconds: rendered, by method and stage; workers: those alive; clashes: determinism failures met.
        """
        now = time.time()
        queues = {name: {"queued": 0, "running": 0, "oldest_s": 0.0} for name in ("gl", "reference", "light")}
        for row in self.records.counts():
            queues[row["queue"]][row["state"]] = row["n"]
            if row["state"] == "queued" and row["oldest"] is not None:
                queues[row["queue"]]["oldest_s"] = max(0.0, now - row["oldest"])
        return {
            "queues": queues, "failures": self.records.failures(), "seconds": self.records.seconds(),
            "workers": [row["id"] for row in self.records.workers()], "clashes": len(self.artifacts.clashes()),
        }  # fmt: skip

    def forget(self, id: str) -> None:
        """Remove an evaluation that has ended from the database; its artefacts stay until nothing names them."""
        if self.records.evaluation(id)["finished"] is not None:
            self._client.forget(id)
            self.records.forget(id)

    def check(self) -> None:
        """Raises StoreError where the database or the store can't be reached or written."""
        self._client.check()
        self.records.check_writable()
        self.artifacts.check_writable()

    def _enqueue(self, id: str) -> None:
        row = self.records.evaluation(id)
        if row["state"] == "queued":
            self._client.enqueue(id, row["attempt"], row["priority"])

    def _plan(self, row: Row) -> Plan:
        return load_plan(self.artifacts, Order.model_validate_json(row["order"]).plan)


def _status(row: Row, done: int, cells: list[Cell]) -> Status:
    finished = None if row["finished"] is None else _iso(row["finished"])
    return Status(
        id=row["id"], state=row["state"], created=_iso(row["created"]), finished=finished, cells=cells, error=row["error"],
        request=EvaluationRequest.model_validate_json(row["request"]), progress={"done": done, "total": row["total"]},
    )  # fmt: skip


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def _to_cursor(row: Row) -> str:
    return base64.urlsafe_b64encode(json.dumps([row["created"], row["id"]]).encode()).decode()


def _from_cursor(text: str) -> tuple[float, str]:
    try:
        created, id = json.loads(base64.urlsafe_b64decode(text))
        return float(created), str(id)
    except (ValueError, TypeError):
        raise ValueError(f"not a cursor: {text!r}") from None
