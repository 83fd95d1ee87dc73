"""kill -9 at every labelled point of worker, child and submitter: nothing accepted is lost, nothing is committed twice.

Each round has a database and a data folder of its own. A process is killed when it comes to a label, another one takes its place,
and what the evaluation gives in the end is compared with what it gives undisturbed.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import databases
import pytest
from waiting import finished, until
from workers import Server, Spec, alive

from jobs import EvaluationRequest, MethodRequest, plan
from jobs.queue import JobQueue

pytestmark = pytest.mark.usefixtures("toy_methods")

WORKER_POINTS = [
    "evaluation begun", "evaluation waiting", "record half written", "reference before work", "child before start",
    "child after end", "render before commit", "artifact before write", "artifact half written", "artifact after write",
    "artifact before bind", "artifact after bind", "render after commit", "render after work", "node before settle",
    "node after settle", "compare before work", "compare after work", "report before write", "report before commit",
    "report after work", "evaluation before conclude",
]  # fmt: skip
SUBMIT_POINTS = ["submit before record", "submit before enqueue", "submit after enqueue"]
CHILD_POINTS = ["render between frames", "child before answer", "child after answer"]
STOP_POINTS = ["child after end", "render before commit", "node before settle"]
ROUNDS = 10
REQUEST = EvaluationRequest.model_validate(
    {"scenes": ["cornell-box"], "methods": [{"name": "flat", "sweep": {"level": [0.5, 0.25]}}], "size": [8, 6]}
)
NODES = 3 + 2 + 1 + 2 + 1  # references, renders, aliasing, comparisons, report
OF_THE_RUN = ("run", "started", "finished", "timings", "peak_rss_bytes", "device", "versions")
NewSpec = Callable[[], Spec]


@pytest.fixture(scope="module")
def warm_server() -> Iterator[Server]:
    with Server() as found:
        yield found


@pytest.fixture
def server(warm_server: Server) -> Iterator[Server]:
    yield warm_server
    warm_server.end_workers()


@pytest.fixture
def new_spec(request: pytest.FixtureRequest, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> NewSpec:
    """Surroundings of one round: a new database, of the kind that the test is for, and a new data folder."""
    numbers = iter(range(1000))

    def make() -> Spec:
        folder = tmp_path / str(next(numbers))
        folder.mkdir()
        if kind == "sqlite":
            database = databases.new_file(request.getfixturevalue("sqlite_template"), folder / "queue.sqlite")
        else:
            database = databases.new_database(request.getfixturevalue("postgres_server"))
        monkeypatch.setenv("LUXMETER_HOME", str(folder / "home"))
        (folder / "effects").touch()
        return Spec(database, str(folder / "home"), str(folder / "effects"))

    return make


@pytest.fixture(params=["sqlite", "postgresql"])
def kind(request: pytest.FixtureRequest) -> str:
    """The database that a test is for."""
    return str(request.param)


@pytest.fixture(scope="module")
def undisturbed(warm_server: Server, tmp_path_factory: pytest.TempPathFactory, sqlite_template: Path) -> list[dict[str, Any]]:
    """Results of the request when nothing is killed."""
    folder = tmp_path_factory.mktemp("undisturbed")
    spec = Spec(databases.new_file(sqlite_template, folder / "queue.sqlite"), str(folder / "home"), str(folder / "effects"))
    with pytest.MonkeyPatch.context() as patch, contextlib.closing(JobQueue(spec.database, f"{spec.home}/artifacts")) as queue:
        patch.setenv("LUXMETER_PLUGINS", "toy_methods")
        id = queue.submit(REQUEST).id
        warm_server.start(spec)
        finished(queue, id)
        warm_server.end_workers()
        return results_of(queue, id)


def results_of(queue: JobQueue, id: str) -> list[dict[str, Any]]:
    """Results without what differs from run to run."""
    return [result.model_dump(exclude=set(OF_THE_RUN)) for result in queue.results(id)]


def whole(queue: JobQueue, id: str, expected: list[dict[str, Any]]) -> None:
    """The evaluation is what an undisturbed one is: each node ended once and well, every file there, no determinism failure."""
    status = finished(queue, id)
    assert (status.state, status.error) == ("done", None)
    assert [cell.state for cell in status.cells] == ["done", "done"]
    assert status.progress == {"done": NODES, "total": NODES}
    assert results_of(queue, id) == expected
    assert len({result.run for result in queue.results(id)}) == 1
    assert queue.report_file(id, "index.html") == b"2 results, ['done', 'done']"
    events = queue.events(id)
    ends = [event["node"] for event in events if event["type"] == "node" and event["state"] == "done"]
    assert sorted(ends) == sorted(set(ends))
    assert len(ends) == NODES
    assert [event["seq"] for event in events] == list(range(1, len(events) + 1))
    assert sum(event.get("finished", False) for event in events) == 1
    assert queue.stats()["clashes"] == 0


def one_round(server: Server, spec: Spec, label: str, expected: list[dict[str, Any]]) -> None:
    """A worker is killed at the label; the next one goes on."""
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        victim = server.start(replace(spec, label=label))
        until(lambda: not alive(victim), f"the worker did not come to {label!r}")
        assert f"reached {label}" in Path(spec.effects).read_text()
        server.start(spec)
        whole(queue, id, expected)
        at_most_one_left_over(queue)
    finally:
        queue.close()
        server.end_workers()


def at_most_one_left_over(queue: JobQueue) -> None:
    """A kill in the middle of writing leaves its temporary file, and nothing else does."""
    stored = [path for path in Path(queue.artifacts.url).rglob(".*") if path.is_file()]
    assert len(stored) <= 1


def submitter_round(server: Server, spec: Spec, label: str, expected: list[dict[str, Any]]) -> None:
    """What a submitter that is killed had accepted is done; what it did not come to accept is accepted when asked again."""
    victim = server.start(replace(spec, label=label, submit=REQUEST.model_dump_json()))
    until(lambda: not alive(victim), "the submitter did not end")
    assert f"reached {label}" in Path(spec.effects).read_text()
    queue = JobQueue(spec.database)
    try:
        known, _ = queue.list()
        assert len(known) == (1 if label == "submit after enqueue" else 0)  # it is recorded and enqueued at once, or neither
        server.start(spec)
        id = known[0].id if known else queue.submit(REQUEST).id
        whole(queue, id, expected)
        assert queue.submit(REQUEST).id == id
        assert len(queue.list()[0]) == 1
    finally:
        queue.close()
        server.end_workers()


def child_round(server: Server, spec: Spec, label: str) -> None:
    """A child that is killed is started again; the second time it lives. toy_methods kills it where the file `kill` says."""
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST.model_copy(update={"methods": [MethodRequest(name="flat")]})).id
        Path(spec.home, "kill").write_text(label)
        server.start(replace(spec, real=True))
        assert finished(queue, id).state == "done"
        assert [result.metrics["matched"]["rmse"] for result in queue.results(id)] == [0]
        assert queue.stats()["clashes"] == 0
        assert Path(spec.effects).read_text().count("start render") == 2
        assert not Path(spec.home, "kill").exists()
    finally:
        queue.close()
        server.end_workers()


@pytest.mark.parametrize("label", WORKER_POINTS)
def test_a_worker_killed_at_any_point(server: Server, new_spec: NewSpec, undisturbed: Any, label: str) -> None:
    one_round(server, new_spec(), label, undisturbed)


@pytest.mark.parametrize("label", SUBMIT_POINTS)
def test_a_submitter_killed_at_any_point(server: Server, new_spec: NewSpec, undisturbed: Any, label: str) -> None:
    submitter_round(server, new_spec(), label, undisturbed)


@pytest.mark.parametrize("label", CHILD_POINTS)
@pytest.mark.parametrize("kind", ["sqlite"], indirect=True)
@pytest.mark.gl
def test_a_child_killed_at_any_point(server: Server, new_spec: NewSpec, label: str) -> None:
    child_round(server, new_spec(), label)


@pytest.mark.slow
@pytest.mark.parametrize("label", WORKER_POINTS)
def test_a_worker_killed_at_any_point_ten_times(server: Server, new_spec: NewSpec, undisturbed: Any, label: str) -> None:
    for _ in range(ROUNDS):
        one_round(server, new_spec(), label, undisturbed)


@pytest.mark.slow
@pytest.mark.parametrize("label", SUBMIT_POINTS)
def test_a_submitter_killed_at_any_point_ten_times(server: Server, new_spec: NewSpec, undisturbed: Any, label: str) -> None:
    for _ in range(ROUNDS):
        submitter_round(server, new_spec(), label, undisturbed)


@pytest.mark.slow
@pytest.mark.parametrize("label", CHILD_POINTS)
@pytest.mark.gl
def test_a_child_killed_at_any_point_ten_times(server: Server, new_spec: NewSpec, label: str) -> None:
    for _ in range(ROUNDS):
        child_round(server, new_spec(), label)


def test_a_worker_that_dies_while_it_takes_over_loses_nothing(server: Server, new_spec: NewSpec, undisturbed: Any) -> None:
    """It has found a worker dead, so nobody finds that again, and dies before it has put the dead one's work back."""
    spec = new_spec()
    shared = replace(spec, store=str(Path(spec.home, "artifacts")), lease_s=1.5)
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        victim = server.start(replace(shared, label="render before commit"))
        until(lambda: not alive(victim), "the worker did not die")
        for name, label in [("second", "takeover before recovery"), ("third", "")]:
            heir = server.start(replace(shared, home=f"{spec.home}-{name}", label=label))
            if label:
                until(lambda pid=heir: not alive(pid), "nobody took over")  # type: ignore[misc]
        whole(queue, id, undisturbed)
    finally:
        queue.close()


def stopped_and_overtaken(server: Server, spec: Spec, label: str, expected: list[dict[str, Any]]) -> None:
    """A worker stops at a label and another one takes over; when the first goes on it changes nothing, and takes work again."""
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        frozen = server.start(replace(spec, label=label, signal=signal.SIGSTOP, lease_s=1.5))
        until(lambda: f"reached {label}" in Path(spec.effects).read_text(), "the worker did not stop")
        other = server.start(replace(spec, lease_s=1.5))
        whole(queue, id, expected)
        before = queue.results(id)
        os.kill(frozen, signal.SIGCONT)
        time.sleep(1.0)
        assert queue.results(id) == before
        assert alive(frozen)
        server.kill(other)
        second = queue.submit(REQUEST.model_copy(update={"seeds": 2})).id
        assert finished(queue, second).state == "done"
    finally:
        queue.close()
        server.end_workers()


def test_a_worker_stopped_in_the_middle_of_a_transaction(server: Server, new_spec: NewSpec, undisturbed: Any) -> None:
    """It holds the one write lock of an SQLite file, or a row of PostgreSQL that every other worker needs."""
    stopped_and_overtaken(server, new_spec(), "record half written", undisturbed)


def test_a_submitter_stopped_in_the_middle_of_a_transaction(server: Server, new_spec: NewSpec, undisturbed: Any) -> None:
    """No worker, so nobody misses its heartbeat; but it keeps others from an SQLite file, and a worker sees to that."""
    spec = replace(new_spec(), lease_s=1.5)
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        more = REQUEST.model_copy(update={"seeds": 2})
        frozen = server.start(replace(spec, label="record half written", signal=signal.SIGSTOP, submit=more.model_dump_json()))
        until(lambda: "reached" in Path(spec.effects).read_text(), "the submitter did not stop")
        server.start(spec)
        whole(queue, id, undisturbed)
        server.kill(frozen, signal.SIGCONT)
        until(lambda: not alive(frozen), "the submitter did not end")
        assert finished(queue, plan(more).id).state == "done"
    finally:
        queue.close()
        server.end_workers()


@pytest.mark.slow
@pytest.mark.parametrize("label", STOP_POINTS)
def test_a_worker_stopped_past_its_lease(server: Server, new_spec: NewSpec, undisturbed: Any, label: str) -> None:
    for _ in range(ROUNDS):
        stopped_and_overtaken(server, new_spec(), label, undisturbed)
