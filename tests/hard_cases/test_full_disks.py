"""Full and read-only disks under the queue's database and under its store: clear states, nothing lost, and on with the work when
space returns."""

from __future__ import annotations

import re
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import faults
import httpx
import pytest
import workers
from http_service import HEALTHY, serving
from waiting import finished

from jobs import EvaluationRequest
from jobs.errors import StoreError
from jobs.queue import JobQueue
from jobs.store import Store
from jobs.tasks import RenderTask
from jobs.worker import Worker
from service.http.app import create_app
from service.http.settings import ServerSettings

pytestmark = pytest.mark.usefixtures("toy_methods")
LEVELS = [k / 8 for k in range(1, 7)]


@pytest.fixture(autouse=True)
def _surroundings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import reports

    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(reports, "write", workers.quick_report)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 4 MiB."""
    try:
        with faults.small_disk(tmp_path / "disk", 4) as folder:
            yield folder
    except PermissionError as reason:
        pytest.skip(f"no file system can be mounted here: {reason}")


def request(**changes: Any) -> EvaluationRequest:
    methods = [{"name": "flat", "sweep": {"level": LEVELS}}]
    return EvaluationRequest.model_validate({"scenes": ["cornell-box"], "methods": methods, "size": [8, 6], **changes})


def worker(queue: JobQueue, tmp_path: Path, runner: Any = workers.flat) -> Worker:
    """Its lease is short: what the database did not keep is found again within seconds."""
    home = Store(tmp_path / "home")
    return Worker(queue.records.url, queue.artifacts.url, poll_s=0.05, runner=runner, home=home, cron=None, lease_s=2.0)


def at_the_second_render(do: Callable[[], object]) -> Any:
    """A runner that does something before the second render."""
    renders = iter(range(1000))

    def runner(task: Any, limits: Any, progress: Any) -> dict[str, Any]:
        if isinstance(task, RenderTask) and next(renders) == 1:
            do()
        return workers.flat(task, limits, progress)

    return runner


def whole(queue: JobQueue, id: str) -> None:
    """Every node ended once and well."""
    status = finished(queue, id)
    assert (status.state, status.error) == ("done", None)
    assert status.progress["done"] == status.progress["total"]
    ends = [e["node"] for e in queue.events(id) if e["type"] == "node" and e["state"] == "done"]
    assert sorted(ends) == sorted(set(ends))
    assert [result.settings["level"] for result in queue.results(id)] == LEVELS
    assert queue.stats()["clashes"] == 0


@pytest.mark.parametrize("kind", ["full", "read-only"])
def test_a_submission_that_the_database_refuses_leaves_nothing(database: str, tmp_path: Path, kind: str) -> None:
    with closing(JobQueue(database)) as queue, faults.faulty(kind) as fault:
        fault.on.set()
        with pytest.raises(StoreError, match=faults.WORDS[kind]):
            queue.submit(request(seeds=8))
        assert queue.list()[0] == []
        fault.on.clear()
        assert queue.submit(request(seeds=8)).state == "queued"


@pytest.mark.parametrize("database", ["sqlite"], indirect=True)
def test_the_service_says_that_it_cannot_now(database: str, tmp_path: Path) -> None:
    """A problem document that says when to ask again; what was accepted before is still answered."""
    body = request().model_dump(mode="json")
    with closing(JobQueue(database)) as queue, faults.faulty("read-only") as fault:
        app = create_app(queue, ServerSettings(home=tmp_path / "home"), machine=lambda: HEALTHY)
        with serving(app) as address, httpx.Client(base_url=address, timeout=60) as client:
            known = client.post("/v1/evaluations", json=body).json()["id"]
            fault.on.set()
            refused = client.post("/v1/evaluations", json=body | {"seeds": 2})
            assert (refused.status_code, refused.json()["type"]) == (503, "/problems/unavailable")
            assert int(refused.headers["retry-after"]) > 0
            assert str(tmp_path) not in refused.text
            assert client.get(f"/v1/evaluations/{known}").json()["state"] == "queued"
            fault.on.clear()
            assert client.post("/v1/evaluations", json=body | {"seeds": 2}).status_code == 202


@pytest.mark.parametrize("kind", ["full", "read-only"])
def test_work_waits_for_a_database_that_refuses_and_goes_on(database: str, tmp_path: Path, kind: str) -> None:
    """No retry is needed: nothing has failed."""
    with closing(JobQueue(database)) as queue, faults.faulty(kind) as fault:
        id = queue.submit(request()).id
        with worker(queue, tmp_path, at_the_second_render(fault.on.set)).working():
            assert fault.met.wait(120)
            time.sleep(1.0)
            waiting = queue.status(id)
            assert (waiting.state, waiting.finished) == ("running", None)
            assert "failed" not in {cell.state for cell in waiting.cells}
            fault.on.clear()
            whole(queue, id)


@pytest.mark.parametrize("kind", ["full", "read-only"])
def test_a_store_on_a_disk_that_refuses(disk: Path, database: str, tmp_path: Path, kind: str) -> None:
    """The nodes that needed it fail and say so; when space has returned, a retry makes what is missing."""
    ballast: list[Path] = []

    def refuse() -> None:
        if kind == "full":
            ballast.append(faults.fill(disk))
        else:
            subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)

    words = {"full": "No space left on device", "read-only": "Read-only file system"}[kind]
    with closing(JobQueue(database, str(disk))) as queue:
        id = queue.submit(request()).id
        with worker(queue, tmp_path, at_the_second_render(refuse)).working():
            status = finished(queue, id)
            assert status.state == "failed"
            assert words in (status.error or "")
            failed = [cell for cell in status.cells if cell.state == "failed"]
            assert failed
            assert all(words in (cell.error or "") for cell in failed)
            assert set(queue.stats()["failures"]) == {"store"}
            with pytest.raises(StoreError, match=words):
                queue.check()
            with pytest.raises(StoreError, match=words):
                queue.submit(request(seeds=2))
            if kind == "full":
                ballast[0].unlink()
            else:
                subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
            queue.check()
            assert queue.retry(id).state == "queued"
            whole(queue, id)
    assert list(queue.artifacts.leftovers()) == []


def test_a_machine_whose_one_disk_is_full(disk: Path, tmp_path: Path) -> None:
    """Database and store on it. What can't be recorded waits, what can't be stored fails; a retry completes it."""
    ballast: list[Path] = []
    with closing(JobQueue(f"sqlite:///{disk / 'queue.sqlite'}", str(disk / "artifacts"))) as queue:
        id = queue.submit(request()).id
        full = threading.Event()

        def refuse() -> None:
            ballast.append(faults.fill(disk))
            full.set()

        with worker(queue, tmp_path, at_the_second_render(refuse)).working():
            assert full.wait(120)
            with pytest.raises(StoreError, match=re.compile("full|No space")):
                queue.submit(request(seeds=8))
            assert [status.id for status in queue.list()[0]] == [id]
            time.sleep(1.0)
            ballast[0].unlink()
            status = finished(queue, id)
            assert all(cell.state == "done" or "No space left on device" in (cell.error or "") for cell in status.cells)
            queue.retry(id)
            whole(queue, id)
