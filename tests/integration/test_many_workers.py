"""The service as a team runs it: PostgreSQL, one API process, three workers of their own data folders, one artefact store."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import databases
import httpx
import pytest
from service_processes import process, service, wait

from jobs.queue import JobQueue

pytestmark = [pytest.mark.mitsuba, pytest.mark.usefixtures("toy_methods")]
LEVELS = [0.25, 0.5, 0.75]
SEEDS = 3
METHODS = [{"name": "flat", "sweep": {"level": LEVELS}}]
ASKED = {"scenes": ["cornell-box"], "methods": METHODS, "size": [8, 6], "seeds": SEEDS, "noise": 0.5}


def test_three_workers_share_one_evaluation(postgres_server: str, tmp_path: Path) -> None:
    url = databases.new_database(postgres_server)
    shared = {"LUXMETER_DATABASE": url, "LUXMETER_STORE": str(tmp_path / "store")}
    with ExitStack() as stack:
        address = stack.enter_context(
            service(shared | {"LUXMETER_HOME": str(tmp_path / "api")}, tmp_path / "api.log", "--no-worker")
        )
        for name in ("one", "two", "three"):
            stack.enter_context(process(["worker"], shared | {"LUXMETER_HOME": str(tmp_path / name)}, tmp_path / f"{name}.log"))
        queue = JobQueue(url, shared["LUXMETER_STORE"])
        stack.callback(queue.close)
        wait(lambda: len(queue.records.workers()) == 3, 90)
        answer = httpx.post(f"{address}/v1/evaluations", json=ASKED, timeout=30)
        assert answer.status_code == 202
        at = f"{address}{answer.headers['location']}"
        wait(lambda: httpx.get(at).json()["state"] not in ("queued", "running"), 120)
        found = httpx.get(at).json()
        assert found["state"] == "done", found
        rows = httpx.get(f"{at}/results").json()["results"]
        assert Counter(row["settings"]["level"] for row in rows) == dict.fromkeys(LEVELS, SEEDS)
        assert httpx.get(f"{at}/report/").status_code == 200
        nodes = queue.records.nodes(found["id"], "node", "state", "worker", "queue")
        assert {node["state"] for node in nodes} == {"done"}
        assert len({node["worker"] for node in nodes if node["queue"] == "gl"}) >= 2, "one worker did all the renders"
        ends = [e["node"] for e in queue.events(found["id"]) if e["type"] == "node" and e["state"] == "done"]
        assert sorted(ends) == sorted(node["node"] for node in nodes)
        assert queue.artifacts.clashes() == []
