"""Many clients, a long history: no error, short answers. Queries are counted; `benchmarks/service.py` tells milliseconds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa
from databases import new_file
from http_service import HEALTHY, serving

from benchmarks.service import fill, renders, start_renders, submit_all, team
from jobs.queue import JobQueue
from service.http.app import create_app
from service.http.settings import ServerSettings

pytestmark = pytest.mark.usefixtures("toy_methods")
MANY = 10_000
FREE = {"requests_per_s": 0.0, "submissions_per_s": 0.0}


def body(number: int) -> dict[str, object]:
    """A request like no other of the test."""
    return {"scenes": ["cornell-box"], "methods": [{"name": "flat", "sweep": {"level": [0.25, 0.5]}}], "size": [8, 6 + number]}


@pytest.fixture
def queue(sqlite_template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[JobQueue]:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    found = JobQueue(new_file(sqlite_template, tmp_path / "queue.sqlite"))
    yield found
    found.close()


@pytest.fixture
def client(queue: JobQueue, tmp_path: Path) -> Iterator[httpx.Client]:
    settings = ServerSettings(home=tmp_path / "home", **FREE)
    with (
        serving(create_app(queue, settings, machine=lambda: HEALTHY)) as address,  # type: ignore[arg-type]
        httpx.Client(base_url=address, timeout=60) as found,
    ):
        yield found


@contextmanager
def statements(queue: JobQueue) -> Iterator[list[tuple[str, Any]]]:
    """Every statement that luxmeter's own tables are asked while the block runs."""
    asked: list[tuple[str, Any]] = []

    def note(connection: object, cursor: object, statement: str, parameters: Any, *more: object) -> None:
        asked.append((statement, parameters))

    engine = queue.records._engine
    sa.event.listen(engine, "before_cursor_execute", note)
    try:
        yield asked
    finally:
        sa.event.remove(engine, "before_cursor_execute", note)


def test_forty_submissions_of_eight_clients(client: httpx.Client, queue: JobQueue) -> None:
    found = submit_all(str(client.base_url), 8, 40, body)
    assert {status for status, _, _ in found} == {202}
    ids = {id for _, _, id in found}
    assert len(ids) == 40
    listed = client.get("/v1/evaluations?limit=200").json()["items"]
    assert {item["id"] for item in listed} == ids
    with statements(queue) as asked:
        client.post("/v1/evaluations", json=body(1000))
    assert len(asked) <= 8, asked


@pytest.mark.parametrize("filtered", [False, True])
def test_a_page_of_ten_thousand_evaluations_takes_two_queries(client: httpx.Client, queue: JobQueue, filtered: bool) -> None:
    fill(queue, client.post("/v1/evaluations", json=body(0)).json()["id"], MANY)
    cursor, state = None, {"state": "queued"} if filtered else {}
    for _ in range(3):
        with statements(queue) as asked:
            answer = client.get("/v1/evaluations", params={"limit": 50} | state | ({"cursor": cursor} if cursor else {})).json()
        assert len(answer["items"]) == 50
        assert all(item["progress"]["total"] == 9 for item in answer["items"])
        cursor = answer["next_cursor"]
        assert len(asked) == 2
    # Both find their rows by an index, and sort nothing: the time of a page does not grow with the history.
    with queue.records.transaction() as c:
        for statement, values in asked:
            plan = [row[3] for row in c.exec_driver_sql(f"explain query plan {statement}", values)]
            assert plan
            assert all("USING" in step and "TEMP" not in step for step in plan), plan


@pytest.mark.slow
@pytest.mark.mitsuba
def test_two_hundred_submissions_of_twenty_clients_while_two_renders_run(tmp_path: Path) -> None:
    """`benchmarks/service.py` says how long they take."""
    with team(tmp_path) as (address, _):
        start_renders(address)
        found = submit_all(address, 20, 200)
        assert renders() >= 2, "the renders ended too early to disturb anything"
    assert {status for status, _, _ in found} == {202}
    assert len({id for _, _, id in found}) == 200
