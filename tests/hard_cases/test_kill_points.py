"""kill -9 at every labelled point of worker and submitter: nothing accepted is lost, nothing is committed twice."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from workers import Server, Spec, alive

from jobs import EvaluationRequest
from jobs.queue import JobQueue, Status

pytestmark = pytest.mark.usefixtures("toy_methods")

WORKER_POINTS = [
    "evaluation begun", "evaluation waiting", "reference before work", "child before start", "child after end",
    "render before commit", "artifact before write", "artifact half written", "artifact after write", "artifact before bind",
    "artifact after bind", "render after commit", "render after work", "node before settle", "node after settle",
    "compare before work", "compare after work", "report before write", "report before commit", "report after work",
    "evaluation before conclude",
]  # fmt: skip
SUBMIT_POINTS = ["submit before record", "submit before enqueue", "submit after enqueue"]
REQUEST = EvaluationRequest.model_validate(
    {"scenes": ["cornell-box"], "methods": [{"name": "flat", "sweep": {"level": [0.5, 0.25]}}], "size": [8, 6]}
)
NODES = 3 + 2 + 1 + 2 + 1  # references, renders, aliasing, comparisons, report


@pytest.fixture(scope="module")
def warm_server() -> Iterator[Server]:
    with Server() as found:
        yield found


@pytest.fixture
def server(warm_server: Server) -> Iterator[Server]:
    yield warm_server
    warm_server.end_workers()


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, database: str) -> Spec:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    (tmp_path / "effects").touch()
    return Spec(database, str(tmp_path / "home"), str(tmp_path / "effects"))


def wait(condition: Callable[[], bool], what: str, seconds: float = 180.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.1)


def finished(queue: JobQueue, id: str) -> Status:
    wait(lambda: queue.status(id).finished is not None, f"{id} did not end")
    return queue.status(id)


def whole(queue: JobQueue, id: str) -> None:
    """The evaluation is what an undisturbed one is: each node ended once and well, every file there, no determinism failure."""
    status = finished(queue, id)
    assert (status.state, status.error) == ("done", None)
    assert [cell.state for cell in status.cells] == ["done", "done"]
    assert status.progress == {"done": NODES, "total": NODES}
    results = queue.results(id)
    assert [result.metrics["matched"]["rmse"] == 0 for result in results] == [True, False]
    assert len({result.run for result in results}) == 1
    page = queue.report_file(id, "index.html")
    assert page == b"2 results, ['done', 'done']"
    ends = [event["node"] for event in queue.events(id) if event["type"] == "node" and event["state"] == "done"]
    assert sorted(ends) == sorted(set(ends))
    assert len(ends) == NODES
    assert [event["seq"] for event in queue.events(id)] == list(range(1, len(queue.events(id)) + 1))
    assert queue.stats()["clashes"] == 0
    stored = [path for path in Path(queue.artifacts.url).rglob("*") if path.is_file()]
    assert not [path for path in stored if path.name.startswith(".")] or _recent(stored)


def _recent(stored: list[Path]) -> bool:
    """A kill in mid write leaves its temporary file; there is at most that one."""
    return len([path for path in stored if path.name.startswith(".")]) == 1


def one_round(server: Server, spec: Spec, label: str) -> None:
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        victim = server.start(replace(spec, label=label))
        wait(lambda: not alive(victim), f"the worker did not come to {label!r}")
        assert f"reached {label}" in Path(spec.effects).read_text()
        server.start(spec)
        whole(queue, id)
    finally:
        queue.close()


@pytest.mark.parametrize("label", WORKER_POINTS)
@pytest.mark.parametrize("database", ["sqlite"], indirect=True)
def test_a_worker_killed_at_any_point(server: Server, spec: Spec, label: str) -> None:
    one_round(server, spec, label)


@pytest.mark.parametrize("label", ["child after end", "render after commit", "node before settle"])
@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_a_worker_killed_with_postgresql(server: Server, spec: Spec, label: str) -> None:
    one_round(server, spec, label)


@pytest.mark.slow
@pytest.mark.parametrize("label", WORKER_POINTS)
def test_a_worker_killed_at_any_point_ten_times(server: Server, spec: Spec, label: str, tmp_path: Path) -> None:
    for number in range(10):
        home = tmp_path / f"home-{number}"
        os.environ["LUXMETER_HOME"] = str(home)
        queue = JobQueue(spec.database)
        request = REQUEST.model_copy(update={"size": (8, 6 + number)})
        try:
            id = queue.submit(request).id
            victim = server.start(replace(spec, home=str(home), label=label))
            wait(lambda pid=victim: not alive(pid), f"the worker did not come to {label!r}")
            fresh = server.start(replace(spec, home=str(home)))
            whole(queue, id)
            server.kill(fresh, signal.SIGTERM)
            wait(lambda pid=fresh: not alive(pid), "the worker did not end")
        finally:
            queue.close()


@pytest.mark.parametrize("label", SUBMIT_POINTS)
def test_a_submitter_killed_at_any_point(server: Server, spec: Spec, label: str) -> None:
    """What it accepted is done; what it did not come to accept is accepted when asked again."""
    victim = server.start(replace(spec, label=label, submit=REQUEST.model_dump_json()))
    wait(lambda: not alive(victim), "the submitter did not end")
    assert f"reached {label}" in Path(spec.effects).read_text()
    queue = JobQueue(spec.database)
    try:
        known, _ = queue.list()
        assert len(known) == (0 if label == "submit before record" else 1)
        server.start(spec)
        id = known[0].id if known else queue.submit(REQUEST).id
        whole(queue, id)
        assert queue.submit(REQUEST).id == id
        assert len(queue.list()[0]) == 1
    finally:
        queue.close()


@pytest.mark.parametrize("label", ["render between frames", "child before answer", "child after answer"])
@pytest.mark.parametrize("database", ["sqlite"], indirect=True)
@pytest.mark.gl
def test_a_child_killed_at_any_point(server: Server, spec: Spec, label: str) -> None:
    """The child is started again; the second time it lives. toy_methods kills it where the file `kill` says."""
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        Path(spec.home, "kill").write_text(label)
        server.start(replace(spec, real=True))
        whole(queue, id)
        assert Path(spec.effects).read_text().count("start render") == 3
    finally:
        queue.close()


def stopped_and_overtaken(server: Server, spec: Spec, label: str) -> None:
    """A worker stops at a label and another one takes over; when the first goes on it changes nothing, and takes work again."""
    queue = JobQueue(spec.database)
    try:
        id = queue.submit(REQUEST).id
        frozen = server.start(replace(spec, label=label, signal=signal.SIGSTOP, lease_s=1.5))
        wait(lambda: f"reached {label}" in Path(spec.effects).read_text(), "the worker did not stop")
        other = server.start(replace(spec, lease_s=1.5))
        whole(queue, id)
        before = queue.results(id)
        os.kill(frozen, signal.SIGCONT)
        time.sleep(1.0)
        assert queue.results(id) == before
        assert alive(frozen)
        server.kill(other)
        second = queue.submit(REQUEST.model_copy(update={"size": (8, 7)})).id
        whole(queue, second)
    finally:
        queue.close()


def test_a_worker_stopped_in_the_middle_of_a_transaction(server: Server, spec: Spec) -> None:
    """It holds the one write lock of an SQLite file, or a row of PostgreSQL that every other worker needs."""
    stopped_and_overtaken(server, spec, "record half written")


@pytest.mark.slow
@pytest.mark.parametrize("label", ["child after end", "render before commit", "node before settle"])
def test_a_worker_stopped_past_its_lease(server: Server, spec: Spec, label: str) -> None:
    stopped_and_overtaken(server, spec, label)
