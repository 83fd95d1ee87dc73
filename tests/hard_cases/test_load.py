"""Many clients, a long history: no error, short answers. By default queries are counted; milliseconds are for the slow tests."""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa
from databases import new_file
from http_service import HEALTHY, serving

from jobs.database import EVALUATIONS, NODES
from jobs.queue import JobQueue
from service.http.app import create_app
from service.http.settings import ServerSettings

pytestmark = pytest.mark.usefixtures("toy_methods")
ROOT = Path(__file__).parents[2]
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


def submit_all(address: str, clients: int, count: int) -> list[tuple[int, float, str]]:
    """Submissions of that many clients at once: status, seconds and id of each."""

    def one(number: int) -> list[tuple[int, float, str]]:
        with httpx.Client(base_url=address, timeout=60) as client:
            client.get("/healthz")  # what is timed is submitting, not connecting
            found = []
            for k in range(number, count, clients):
                start = time.perf_counter()
                answer = client.post("/v1/evaluations", json=body(k))
                found.append((answer.status_code, time.perf_counter() - start, answer.json().get("id", "")))
            return found

    with ThreadPoolExecutor(clients) as pool:
        return [entry for own in pool.map(one, range(clients)) for entry in own]


def fill(queue: JobQueue, client: httpx.Client) -> None:
    """Put copies of one evaluation into the database until there are MANY."""
    id = client.post("/v1/evaluations", json=body(0)).json()["id"]
    row, nodes = queue.records.evaluation(id), queue.records.nodes(id, *NODES.c.keys())
    ids = [f"{k:016x}" for k in range(MANY - 1)]
    with queue.records.transaction() as c:
        c.execute(sa.insert(EVALUATIONS), [{**row, "id": own, "created": row["created"] - 1 - k} for k, own in enumerate(ids)])
        c.execute(sa.insert(NODES), [{**node, "evaluation": own, "state": "done"} for own in ids for node in nodes])


def test_forty_submissions_of_eight_clients(client: httpx.Client, queue: JobQueue) -> None:
    found = submit_all(str(client.base_url), 8, 40)
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
    fill(queue, client)
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


@pytest.fixture
def service(tmp_path: Path) -> Iterator[str]:
    """A service with two workers of their own data folders, which don't wait for each other's renders."""
    env = os.environ | {"LUXMETER_HOME": str(tmp_path / "home"), "LUXMETER_DATABASE": f"sqlite:///{tmp_path / 'queue.sqlite'}"}
    env["LUXMETER_STORE"] = str(tmp_path / "store")
    port = 18_000 + os.getpid() % 1000
    rates = ["--request-rate", "0", "--submission-rate", "0"]  # all clients of this test share one address
    commands = [[sys.executable, "-m", "service", *more] for more in (["serve", "--port", str(port), *rates], ["worker"])]
    homes = [str(tmp_path / "home"), str(tmp_path / "other")]
    with (tmp_path / "log").open("wb") as log:
        started = [
            subprocess.Popen(command, cwd=ROOT, env=env | {"LUXMETER_HOME": home}, stderr=log)
            for command, home in zip(commands, homes, strict=True)
        ]
        try:
            wait(lambda: httpx.get(f"http://127.0.0.1:{port}/healthz").status_code == 200, 60)
            yield f"http://127.0.0.1:{port}"
        finally:
            for process in started:
                process.send_signal(signal.SIGTERM)
            for process in started:
                process.wait(60)


def wait(ready: object, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            if ready():  # type: ignore[operator]
                return
        except httpx.TransportError:
            pass
        time.sleep(0.2)
    raise AssertionError(f"not within {seconds} s")


def renders() -> list[int]:
    """Process ids of the children that have rendered for two seconds of processor time."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            command, stat = (path / "cmdline").read_bytes(), (path / "stat").read_text()
        except (FileNotFoundError, ProcessLookupError):
            continue
        ticks = sum(map(int, stat.rsplit(")", 1)[1].split()[11:13]))
        if b"jobs.child" in command and ticks / os.sysconf("SC_CLK_TCK") > 2:
            found.append(int(path.name))
    return found


def percentile(seconds: list[float], share: int) -> float:
    """The value that `share` percent are not above."""
    return statistics.quantiles(seconds, n=100, method="inclusive")[share - 1]


@pytest.mark.slow
@pytest.mark.mitsuba
def test_two_hundred_submissions_of_twenty_clients_while_two_renders_run(service: str, record_property: object) -> None:
    methods = [{"name": "pt", "settings": {"spp": 65_536}}]
    for seeds in (1, 2):
        asked = {"scenes": ["cornell-box"], "methods": methods, "size": [320, 180], "noise": 1.0, "seeds": seeds, "priority": 0}
        assert httpx.post(f"{service}/v1/evaluations", json=asked, timeout=60).status_code == 202
    wait(lambda: len(renders()) >= 2, 120)
    found = submit_all(service, 20, 200)
    assert len(renders()) >= 2, "the renders ended too early to disturb anything"
    assert {status for status, _, _ in found} == {202}
    assert len({id for _, _, id in found}) == 200
    seconds = [taken for _, taken, _ in found]
    figures = {f"p{share}": round(1000 * percentile(seconds, share)) for share in (50, 95, 99)}
    print(f"POST, 20 clients at once, two renders running: {figures} ms")
    assert percentile(seconds, 99) < 0.25, figures


@pytest.mark.slow
def test_a_page_of_ten_thousand_evaluations_takes_a_tenth_of_a_second(client: httpx.Client, queue: JobQueue) -> None:
    fill(queue, client)
    seconds, cursor = [], None
    for _ in range(20):
        start = time.perf_counter()
        answer = client.get("/v1/evaluations", params={"limit": 50} | ({"cursor": cursor} if cursor else {}))
        seconds.append(time.perf_counter() - start)
        cursor = answer.json()["next_cursor"]
    print(f"a page of 50 of {MANY}: median {1000 * statistics.median(seconds):.1f} ms, slowest {1000 * max(seconds):.1f} ms")
    assert max(seconds) < 0.1
