"""Records against a model: in whatever order submissions, starts, ends, heartbeats, cancels and retries come, both say the same."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from jobs import records as module
from jobs.database import WORKERS as WORKERS_TABLE
from jobs.graph import Node
from jobs.outcome import CANCELLED, Order, Outcome
from jobs.records import LIVE, Records

NODES = [Node("render:a", "render", "a", "gl"), Node("render:b", "render", "b", "gl"), Node("report", "report", "", "light")]
NAMES = st.sampled_from([node.id for node in NODES])
WORKERS = st.sampled_from(["w0", "w1", "w2"])
OUTCOMES = {
    "done": Outcome(files={"a": "0" * 64}, seconds={"render": 1.0}),
    "failed": Outcome(state="failed", error="broken", failure="error"),
    "cancelled": CANCELLED,
}
LEASE_S = 10.0
URL = "sqlite://"


class Clock:
    """Time that passes only when told."""

    def __init__(self) -> None:
        self.now = 1000.0

    def time(self) -> float:
        return self.now


class Machine(RuleBasedStateMachine):
    """One evaluation with three nodes, three workers, and a clock."""

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        module.time = self.clock  # type: ignore[assignment]
        self.records = Records(URL)
        self.records._now = lambda connection: self.clock.now  # type: ignore[method-assign]
        self.id = "e"
        self.state: str | None = None
        self.finished = False
        self.attempt = 1
        self.nodes: dict[str, str] = {}
        self.seen: dict[str, float] = {}
        self.events = 0

    def teardown(self) -> None:
        self.records.forget(self.id)
        with self.records.transaction() as connection:
            connection.execute(WORKERS_TABLE.delete())
        self.records.close()

    @rule()
    def submit(self) -> None:
        order = Order(evaluation=self.id, plan="0" * 64, run="r", created="now")
        added = self.records.add(order, "{}", 5, [(node, "flat") for node in NODES], self.clock.now)
        assert added == (self.state is None)
        if added:
            self.state, self.nodes, self.events = "queued", dict.fromkeys((node.id for node in NODES), "queued"), 1

    @precondition(lambda self: self.state)
    @rule(back=st.integers(0, 1))
    def begin(self, back: int) -> None:
        attempt = self.attempt - back
        expected = self.state in LIVE and back == 0
        assert self.records.begin(self.id, attempt) == expected
        assert self.records.wanted(self.id, attempt) == expected
        if expected:
            self.state = "running"
            self.events += 1

    @precondition(lambda self: self.state)
    @rule(name=NAMES, worker=WORKERS, back=st.integers(0, 1))
    def start(self, name: str, worker: str, back: int) -> None:
        self.records.start(self.id, self.attempt - back, name, worker, {})
        if back == 0 and self.nodes[name] in LIVE:
            self.nodes[name] = "running"
            self.events += 1

    @precondition(lambda self: self.state)
    @rule(name=NAMES, state=st.sampled_from(sorted(OUTCOMES)), back=st.integers(0, 1))
    def end(self, name: str, state: str, back: int) -> None:
        """An end of an attempt that was given up, or a second end, changes nothing."""
        self.records.end(self.id, self.attempt - back, name, OUTCOMES[state], {})
        if back == 0 and self.nodes[name] in LIVE:
            self.nodes[name] = state
            self.events += 1

    @precondition(lambda self: self.state)
    @rule()
    def cancel(self) -> None:
        assert self.records.cancel(self.id) == (self.state in LIVE)
        if self.state in LIVE:
            self.state = "cancelled"
            self.events += 1

    @precondition(lambda self: self.state)
    @rule(state=st.sampled_from(["done", "failed"]), back=st.integers(0, 1))
    def finish(self, state: str, back: int) -> None:
        self.records.finish(self.id, self.attempt - back, state, None)  # type: ignore[arg-type]
        if back == 0 and (self.state in LIVE or (self.state == "cancelled" and not self.finished)):
            self.state = state if self.state in LIVE else "cancelled"
            self.finished = True
            self.events += 1

    @precondition(lambda self: self.state)
    @rule(lost=st.lists(NAMES, unique=True))
    def retry(self, lost: list[str]) -> None:
        attempt = self.records.again(self.id, lost)
        if self.state not in ("failed", "cancelled"):
            assert attempt is None
            return
        self.attempt += 1
        assert attempt == self.attempt
        self.state, self.finished = "queued", False
        self.events += 1
        for name, state in self.nodes.items():
            if state != "done" or name in lost or name == "report":
                self.nodes[name] = "queued"

    @rule(worker=WORKERS)
    def beat(self, worker: str) -> None:
        dead = self.records.beat(worker, 0.0, LEASE_S)
        expected = sorted(w for w, seen in self.seen.items() if seen < self.clock.now - LEASE_S and w != worker)
        assert sorted(dead) == expected
        self.seen = {w: seen for w, seen in self.seen.items() if w not in expected} | {worker: self.clock.now}

    @rule(worker=WORKERS)
    def leave(self, worker: str) -> None:
        self.records.leave(worker)
        if worker in self.seen:
            self.seen[worker] = 0.0

    @rule(seconds=st.floats(0.5, 20))
    def passes(self, seconds: float) -> None:
        self.clock.now += seconds

    @invariant()
    def tables_say_the_same(self) -> None:
        assert [row["id"] for row in self.records.workers()] == sorted(w for w, seen in self.seen.items() if seen > 0)
        if self.state is None:
            return
        row = self.records.evaluation(self.id)
        assert (row["state"], row["attempt"], row["finished"] is not None) == (self.state, self.attempt, self.finished)
        assert {n["node"]: n["state"] for n in self.records.nodes(self.id, "node", "state")} == self.nodes
        assert {name: o.state for name, o in self.records.outcomes(self.id).items()} == {
            name: state for name, state in self.nodes.items() if state not in LIVE
        }
        assert [event["seq"] for event in self.records.events(self.id, 0)] == list(range(1, self.events + 1))


def test_records_follow_the_model(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On SQLite in memory, which is a hundred times faster than a file, and on PostgreSQL; few steps on the slower one."""
    fast = database.startswith("sqlite")
    monkeypatch.setattr(module, "time", module.time)
    monkeypatch.setitem(globals(), "URL", "sqlite://" if fast else database)
    limits = settings(max_examples=60 if fast else 8, stateful_step_count=30, deadline=None, database=None)
    run_state_machine_as_test(Machine, settings=limits)
