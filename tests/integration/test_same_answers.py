"""One request, asked on the command line and over HTTP: the same results, rendered once; and what is shown where they differ."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import httpx
import pandas as pd
import pytest
import workers
from http_service import HEALTHY, serving
from waiting import until

import jobs
from jobs.queue import JobQueue
from jobs.store import Store
from jobs.worker import Worker
from reports.folder import read
from service.http.app import create_app
from service.http.settings import ServerSettings

pytestmark = [pytest.mark.usefixtures("toy_methods"), pytest.mark.gl]
BODY: dict[str, Any] = {"scenes": ["cornell-box"], "methods": [{"name": "flat", "sweep": {"level": [0.5, 0.25]}}], "size": [16, 12]}
FICKLE = BODY | {"methods": [{"name": "flat", "settings": {"mode": "fickle"}}]}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "rendered").touch()
    return tmp_path / "home"


def evaluate(body: dict[str, Any], folder: Path) -> str:
    """As `luxmeter evaluate` does; the evaluation's id."""
    planned = jobs.plan(jobs.EvaluationRequest.model_validate(body))
    return jobs.evaluate(planned, folder, jobs.Options(runner=workers.half_real)).id


@contextmanager
def service(home: Path) -> Iterator[httpx.Client]:
    """The service with its queue and a worker, both on the data folder."""
    with closing(JobQueue()) as queue:
        app = create_app(queue, ServerSettings(home=home), machine=lambda: HEALTHY)
        worker = Worker(poll_s=0.05, runner=workers.half_real, home=Store(home), cron=None)
        with worker.working(), serving(app) as address, httpx.Client(base_url=address, timeout=60) as client:
            yield client


def submitted(client: httpx.Client, body: dict[str, Any]) -> dict[str, Any]:
    """Submit and wait for the end; the evaluation."""
    answer = client.post("/v1/evaluations", json=body)
    assert answer.status_code == 202
    at = answer.headers["location"]
    until(lambda: client.get(at).json()["finished"] is not None, f"{at} did not end")
    return dict(client.get(at).json())


def rendered(home: Path) -> int:
    """How many frames methods have rendered so far, those that only warm up among them."""
    return len((home / "rendered").read_text().splitlines())


def test_the_second_answer_is_the_first_ones(home: Path, tmp_path: Path) -> None:
    id = evaluate(BODY, tmp_path / "out")
    before = rendered(home)
    assert before == 4  # two methods' settings, each after a warm-up
    with service(home) as client:
        found = submitted(client, BODY)
        rows = client.get(f"/v1/evaluations/{id}/results").json()["results"]
        images = [client.get(f"/v1/evaluations/{id}/report/images/{cell['id']}.exr").content for cell in found["cells"]]
        page = client.get(f"/v1/evaluations/{id}/report/")
    assert rendered(home) == before
    assert (found["id"], found["state"]) == (id, "done")
    evaluation, results = read(tmp_path / "out")
    assert [row["frame_hash"] for row in rows] == [results[cell.id].frame_hash for cell in evaluation.cells]
    assert [row["metrics"] for row in rows] == [results[cell.id].metrics for cell in evaluation.cells]
    stored = [(tmp_path / "out" / "images" / f"{cell.id}.exr").read_bytes() for cell in evaluation.cells]
    assert [hashlib.sha256(image).hexdigest() for image in images] == [hashlib.sha256(image).hexdigest() for image in stored]
    assert all("from the cache" in row["notes"][-1] for row in rows)
    assert page.status_code == 200


def test_the_command_line_renders_anew_what_the_service_has(home: Path, tmp_path: Path) -> None:
    """Its times are of one run; pixels and counts are the same."""
    with service(home) as client:
        found = submitted(client, BODY)
        rows = client.get(f"/v1/evaluations/{found['id']}/results").json()["results"]
    before = rendered(home)
    assert evaluate(BODY, tmp_path / "out") == found["id"]
    assert rendered(home) == 2 * before
    evaluation, results = read(tmp_path / "out")
    assert [row["frame_hash"] for row in rows] == [results[cell.id].frame_hash for cell in evaluation.cells]
    assert all(results[cell.id].notes == [] for cell in evaluation.cells)


def test_a_method_that_is_not_deterministic_is_shown_wherever_it_is_asked_for(home: Path, tmp_path: Path) -> None:
    """In results, tables and the page of the run that differs, and from then on in every answer from the cache."""
    evaluate(FICKLE, tmp_path / "first")
    evaluate(FICKLE, tmp_path / "second")
    for name, shown in (("first", False), ("second", True)):
        folder = tmp_path / name
        (result,) = read(folder)[1].values()
        assert any(note.startswith("determinism failure") for note in result.notes) == shown
        assert pd.read_csv(folder / "results.csv", keep_default_na=False)["notes"][0].startswith("determinism failure") == shown
        assert ("<h3>Determinism failures</h3>" in (folder / "index.html").read_text()) == shown
    with service(home) as client:
        found = submitted(client, FICKLE)
        base = f"/v1/evaluations/{found['id']}"
        (row,) = client.get(f"{base}/results").json()["results"]
        table = client.get(f"{base}/results", headers={"accept": "text/csv"}).text
        page = client.get(f"{base}/report/").text
        metrics = client.get("/metrics").text
    assert any(note.startswith("determinism failure") for note in row["notes"])
    assert "determinism failure" in table
    assert "<h3>Determinism failures</h3>" in page
    assert "luxmeter_determinism_failures" in metrics
    with closing(JobQueue()) as queue:
        assert queue.stats()["clashes"] == 1
