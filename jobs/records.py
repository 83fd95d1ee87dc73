"""What is known of every evaluation: its state, its nodes, its events; and which workers live. Rows of luxmeter's own tables.

Every change of a node names the attempt it belongs to, so that a worker that was given up can't write over its successor's work.
"""

from __future__ import annotations

import json
import sqlite3
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa

from jobs.database import EVALUATIONS, EVENTS, IDLE_S, NODES, WAIT_S, WORKERS, is_sqlite, open_database, readable_errors
from jobs.graph import Node
from jobs.outcome import Order, Outcome
from jobs.points import reach
from reports.folder import State

LIVE = ("queued", "running")
ASK_S = 0.001
Row = Mapping[str, Any]


class Records:
    """The tables of one database. Every method is one transaction; raises StoreError where the database can't be used.

    wait_s, idle_s, flush: see `open_database`.
    """

    def __init__(self, url: str, wait_s: float = WAIT_S, idle_s: float = IDLE_S, flush: bool = True) -> None:
        self.url, self._wait_s = url, wait_s
        self._engine = open_database(url, wait_s, idle_s, flush)

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    @contextmanager
    def transaction(self) -> Iterator[sa.Connection]:
        """A transaction, with errors as StoreError."""
        with readable_errors(self.url), self._engine.begin() as connection:
            yield connection

    @contextmanager
    def urgent(self) -> Iterator[sa.Connection]:
        """A transaction that writes, and gets SQLite's write lock soon after it is free.

        SQLite's own wait asks ever more seldom, in the end ten times a second: among many writers, who has waited longest asks
        least, and waits for seconds. This one asks every millisecond for as long.
        """
        if not is_sqlite(self.url):
            with self.transaction() as connection:
                yield connection
            return
        with readable_errors(self.url), self._engine.connect() as connection:
            _begin(connection, self._wait_s)
            with connection.begin():
                yield connection

    def add(self, order: Order, request: str, priority: int, nodes: Sequence[tuple[Node, str | None]], created: float) -> bool:
        """Add an evaluation and its nodes (node, method), all queued, unless it is there; whether it was added."""
        with self.transaction() as c:
            return self.add_within(c, order, request, priority, nodes, created)

    def add_within(
        self, c: sa.Connection, order: Order, request: str, priority: int, nodes: Sequence[tuple[Node, str | None]], created: float
    ) -> bool:
        """`add` as a part of a transaction."""
        row = {
            "id": order.evaluation, "created": created, "state": "queued", "priority": priority, "attempt": 1, "request": request,
            "order": order.model_dump_json(), "total": len(nodes), "events": 0,
        }  # fmt: skip
        new = self._insert(EVALUATIONS).values(row).on_conflict_do_nothing().returning(EVALUATIONS.c.id)
        if c.execute(new).scalar() is None:
            return False
        c.execute(
            sa.insert(NODES),
            [
                {"evaluation": order.evaluation, "node": n.id, "attempt": 1, "queue": n.queue, "state": "queued", "method": m}
                for n, m in nodes
            ],
        )
        self._say(c, order.evaluation, {"type": "evaluation", "state": "queued"})
        return True

    def evaluation(self, id: str) -> Row:
        """One evaluation's row. Raises KeyError."""
        with self.transaction() as c:
            row = c.execute(sa.select(EVALUATIONS).where(EVALUATIONS.c.id == id)).mappings().first()
        if row is None:
            raise KeyError(id)
        return dict(row)

    def page(self, state: str | None, limit: int, before: tuple[float, str] | None) -> list[Row]:
        """Evaluations from the newest on, those after `before` (created, id)."""
        query = sa.select(EVALUATIONS).order_by(EVALUATIONS.c.created.desc(), EVALUATIONS.c.id.desc()).limit(limit)
        if state is not None:
            query = query.where(EVALUATIONS.c.state == state)
        if before is not None:
            query = query.where(sa.tuple_(EVALUATIONS.c.created, EVALUATIONS.c.id) < before)
        with self.transaction() as c:
            return [dict(row) for row in c.execute(query).mappings()]

    def nodes(self, id: str, *columns: str) -> list[Row]:
        """Rows of an evaluation's nodes with these columns."""
        chosen = [NODES.c[name] for name in columns]
        with self.transaction() as c:
            return [dict(row) for row in c.execute(sa.select(*chosen).where(NODES.c.evaluation == id)).mappings()]

    def outcomes(self, id: str) -> dict[str, Outcome]:
        """Outcomes of the nodes that have ended, by node id."""
        rows = self.nodes(id, "node", "outcome")
        return {row["node"]: Outcome.model_validate_json(row["outcome"]) for row in rows if row["outcome"] is not None}

    def done_counts(self, ids: Iterable[str]) -> dict[str, int]:
        """How many nodes of each evaluation have ended."""
        query = sa.select(NODES.c.evaluation, sa.func.count()).where(NODES.c.evaluation.in_(list(ids)), NODES.c.state.not_in(LIVE))
        with self.transaction() as c:
            return {row[0]: row[1] for row in c.execute(query.group_by(NODES.c.evaluation))}

    def begin(self, id: str, attempt: int) -> bool:
        """The evaluation's work starts; False where it is cancelled already, or this attempt isn't the latest."""
        with self.transaction() as c:
            started = self._update(c, id, attempt, ("queued", "running"), state="running")
            if started:
                self._say(c, id, {"type": "evaluation", "state": "running"})
            return started

    def wanted(self, id: str, attempt: int) -> bool:
        """Whether this attempt is still to be worked on."""
        query = sa.select(EVALUATIONS.c.state).where(EVALUATIONS.c.id == id, EVALUATIONS.c.attempt == attempt)
        with self.transaction() as c:
            return c.execute(query).scalar() in LIVE

    def finish(self, id: str, attempt: int, state: State, error: str | None) -> None:
        """The evaluation's work has ended. A cancelled one stays cancelled; only its end is noted."""
        with self.transaction() as c:
            now = time.time()
            if not self._update(c, id, attempt, LIVE, state=state, finished=now, error=error):
                state, error = "cancelled", None
                where = (EVALUATIONS.c.id == id, EVALUATIONS.c.attempt == attempt, EVALUATIONS.c.state == "cancelled")
                noted = sa.update(EVALUATIONS).where(*where, EVALUATIONS.c.finished.is_(None)).values(finished=now)
                if not c.execute(noted).rowcount:
                    return
            self._say(c, id, {"type": "evaluation", "state": state, "error": error, "finished": True})

    def cancel(self, id: str) -> bool:
        """Mark an evaluation cancelled unless it has ended; whether it was."""
        with self.transaction() as c:
            where = (EVALUATIONS.c.id == id, EVALUATIONS.c.state.in_(LIVE))
            if not c.execute(sa.update(EVALUATIONS).where(*where).values(state="cancelled", error="cancelled")).rowcount:
                return False
            self._say(c, id, {"type": "evaluation", "state": "cancelled"})
            return True

    def again(self, id: str, lost: Iterable[str]) -> int | None:
        """Start another attempt of a failed or cancelled evaluation: nodes that are done stay but for `lost`; its number."""
        with self.transaction() as c:
            where = (EVALUATIONS.c.id == id, EVALUATIONS.c.state.in_(("failed", "cancelled")))
            values = {"state": "queued", "finished": None, "error": None, "attempt": EVALUATIONS.c.attempt + 1}
            attempt = c.execute(sa.update(EVALUATIONS).where(*where).values(values).returning(EVALUATIONS.c.attempt)).scalar()
            if attempt is None:
                return None
            again = (NODES.c.state != "done") | NODES.c.node.in_([*lost, "report"])
            fresh = {
                "state": "queued",
                "outcome": None,
                "error": None,
                "failure": None,
                "worker": None,
                "ready": None,
                "ended": None,
            }
            c.execute(sa.update(NODES).where(NODES.c.evaluation == id, again).values(fresh))
            c.execute(sa.update(NODES).where(NODES.c.evaluation == id).values(attempt=attempt))
            self._say(c, id, {"type": "evaluation", "state": "queued"})
            return int(attempt)

    def ready(self, id: str, attempt: int, nodes: Sequence[str]) -> None:
        """Nodes that wait in their queues from now on, where it isn't known that they did before."""
        where = (NODES.c.evaluation == id, NODES.c.attempt == attempt, NODES.c.node.in_(nodes), NODES.c.ready.is_(None))
        with self.transaction() as c:
            c.execute(sa.update(NODES).where(*where).values(ready=time.time()))

    def start(self, id: str, attempt: int, node: str, worker: str, event: dict[str, Any]) -> None:
        """A worker has taken a node."""
        with self.transaction() as c:
            self._lock(c, id)
            if self._node(c, id, attempt, node, LIVE, state="running", worker=worker):
                self._say(c, id, {"type": "node", "node": node, "state": "running", **event})

    def end(self, id: str, attempt: int, node: str, outcome: Outcome, event: dict[str, Any]) -> None:
        """A node has ended. Its first end counts; a later one changes nothing."""
        values = {
            "state": outcome.state, "error": outcome.error, "failure": outcome.failure, "outcome": outcome.model_dump_json(),
            "ended": time.time(), "prepare_s": outcome.seconds.get("prepare"), "render_s": outcome.seconds.get("render"),
        }  # fmt: skip
        with self.transaction() as c:
            self._lock(c, id)
            if self._node(c, id, attempt, node, LIVE, **values):
                where = (NODES.c.evaluation == id, NODES.c.state.not_in(LIVE))
                done = c.execute(sa.select(sa.func.count()).select_from(NODES).where(*where)).scalar()
                news = {"node": node, "state": outcome.state, "error": outcome.error, "progress": {"done": done}}
                self._say(c, id, {"type": "node", **news, **event})

    def say(self, id: str, event: dict[str, Any]) -> None:
        """Add an event."""
        with self.transaction() as c:
            self._say(c, id, event)

    def events(self, id: str, after: int, limit: int = 1000) -> list[dict[str, Any]]:
        """Events of an evaluation from number `after` + 1 on. Raises KeyError."""
        query = sa.select(EVENTS.c.event).where(EVENTS.c.evaluation == id, EVENTS.c.seq > after).order_by(EVENTS.c.seq).limit(limit)
        with self.transaction() as c:
            found = [json.loads(text) for text in c.execute(query).scalars()]
        if not found:
            self.evaluation(id)
        return found

    def beat(self, worker: str, started: float, lease_s: float) -> list[str]:
        """Say that a worker lives; returns those that were silent for longer than the lease, which count as dead from now on."""
        with self.transaction() as c:
            now = self._now(c)
            new = self._insert(WORKERS).values(id=worker, started=started, seen=now)
            c.execute(new.on_conflict_do_update(index_elements=["id"], set_={"seen": now, "started": started}))
            dead = sa.delete(WORKERS).where(WORKERS.c.seen < now - lease_s, WORKERS.c.id != worker).returning(WORKERS.c.id)
            return list(c.execute(dead).scalars())

    def leave(self, worker: str) -> None:
        """A worker ends in good order: what it left is taken over at the next heartbeat of another one."""
        with self.transaction() as c:
            c.execute(sa.update(WORKERS).where(WORKERS.c.id == worker).values(seen=0.0))

    def workers(self) -> list[Row]:
        """Workers that have neither ended nor been found dead."""
        query = sa.select(WORKERS).where(WORKERS.c.seen > 0).order_by(WORKERS.c.id)
        with self.transaction() as c:
            return [dict(row) for row in c.execute(query).mappings()]

    def ended_before(self, moment: float) -> list[str]:
        """Evaluations that ended before this time (seconds since 1970), the oldest first."""
        query = sa.select(EVALUATIONS.c.id).where(EVALUATIONS.c.finished < moment).order_by(EVALUATIONS.c.finished)
        with self.transaction() as c:
            return list(c.execute(query).scalars())

    def all_orders(self) -> list[Order]:
        """Orders of every evaluation."""
        with self.transaction() as c:
            return [Order.model_validate_json(text) for text in c.execute(sa.select(EVALUATIONS.c.order)).scalars()]

    def forget(self, id: str) -> None:
        """Remove all rows of an evaluation."""
        with self.transaction() as c:
            c.execute(sa.delete(NODES).where(NODES.c.evaluation == id))
            c.execute(sa.delete(EVENTS).where(EVENTS.c.evaluation == id))
            c.execute(sa.delete(EVALUATIONS).where(EVALUATIONS.c.id == id))

    def check_writable(self) -> None:
        """Raises StoreError where nothing can be written."""
        probe = f"probe {uuid.uuid4()}"
        with self.transaction() as c:
            c.execute(sa.insert(WORKERS).values(id=probe, started=0.0, seen=0.0))
            c.execute(sa.delete(WORKERS).where(WORKERS.c.id == probe))

    def counts(self) -> list[Row]:
        """Queued and running nodes of each queue, and since when the oldest waits."""
        columns = (NODES.c.queue, NODES.c.state, sa.func.count().label("n"), sa.func.min(NODES.c.ready).label("oldest"))
        query = sa.select(*columns).where(NODES.c.state.in_(LIVE)).group_by(NODES.c.queue, NODES.c.state)
        with self.transaction() as c:
            return [dict(row) for row in c.execute(query).mappings()]

    def failures(self) -> dict[str, int]:
        """Ended nodes by kind of failure; what failed only because something before it did isn't counted."""
        query = sa.select(NODES.c.failure, sa.func.count()).where(NODES.c.failure.is_not(None), NODES.c.failure != "needs")
        with self.transaction() as c:
            return {row[0]: row[1] for row in c.execute(query.group_by(NODES.c.failure))}

    def seconds(self) -> dict[str, dict[str, float]]:
        """Seconds rendered by method and stage."""
        columns = (NODES.c.method, sa.func.sum(NODES.c.prepare_s), sa.func.sum(NODES.c.render_s))
        query = sa.select(*columns).where(NODES.c.method.is_not(None)).group_by(NODES.c.method)
        with self.transaction() as c:
            return {row[0]: {"prepare": row[1] or 0.0, "render": row[2] or 0.0} for row in c.execute(query)}

    def _now(self, c: sa.Connection) -> float:
        """Seconds since 1970 by the one clock that all workers of this database share."""
        return time.time() if is_sqlite(self.url) else float(c.execute(sa.text("select extract(epoch from now())")).scalar_one())

    def _insert(self, table: sa.Table) -> Any:
        from sqlalchemy.dialects import postgresql, sqlite

        return (sqlite if is_sqlite(self.url) else postgresql).insert(table)

    def _update(self, c: sa.Connection, id: str, attempt: int, states: Sequence[str], **values: Any) -> bool:
        where = (EVALUATIONS.c.id == id, EVALUATIONS.c.attempt == attempt, EVALUATIONS.c.state.in_(states))
        return bool(c.execute(sa.update(EVALUATIONS).where(*where).values(**values)).rowcount)

    def _node(self, c: sa.Connection, id: str, attempt: int, node: str, states: Sequence[str], **values: Any) -> bool:
        where = (NODES.c.evaluation == id, NODES.c.node == node, NODES.c.attempt == attempt, NODES.c.state.in_(states))
        return bool(c.execute(sa.update(NODES).where(*where).values(**values)).rowcount)

    def _lock(self, c: sa.Connection, id: str) -> None:
        """Hold the evaluation's row before those of its nodes, in every transaction, so that none waits in a circle."""
        c.execute(sa.select(EVALUATIONS.c.id).where(EVALUATIONS.c.id == id).with_for_update())

    def _say(self, c: sa.Connection, id: str, event: dict[str, Any]) -> None:
        """Add an event under the next number: the evaluation's row is locked by counting up, so numbers appear in order."""
        count = sa.update(EVALUATIONS).where(EVALUATIONS.c.id == id).values(events=EVALUATIONS.c.events + 1)
        seq = c.execute(count.returning(EVALUATIONS.c.events)).scalar()
        if seq is None:
            raise KeyError(id)
        reach("record half written")
        stored = {"seq": seq, "time": time.time(), **event}
        c.execute(sa.insert(EVENTS).values(evaluation=id, seq=seq, event=json.dumps(stored)))


def _begin(connection: sa.Connection, wait_s: float) -> None:
    """Take SQLite's write lock. Raises sqlite3.OperationalError where others hold it all that time."""
    driver: Any = connection.connection.dbapi_connection
    driver.execute("pragma busy_timeout=0")
    end = time.monotonic() + wait_s
    try:
        while True:
            try:
                driver.execute("begin immediate")
                return
            except sqlite3.OperationalError as error:
                if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > end:
                    raise
            time.sleep(ASK_S)
    finally:
        driver.execute(f"pragma busy_timeout={round(wait_s * 1000)}")
