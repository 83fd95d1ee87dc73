"""`luxmeter serve` with its own worker, and the command line's client: from submission to the fetched report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_processes import service

from service.cli import run
from service.tokens import TokenStore

ASKED = ["--scene", "corner", "--method", "flat", "--sweep", "flat.level=0.25,0.5", "--size", "8x6", "--noise", "0.5"]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, toy_methods: None) -> Path:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def server(home: Path, tmp_path: Path) -> Iterator[str]:
    """A server process; told to stop, it ends well and takes its worker with it."""
    log = tmp_path / "log.txt"
    with service({"LUXMETER_HOME": str(home)}, log) as address:
        yield address
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert not [line for line in lines if line["level"] == "error"]


def said(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


@pytest.mark.mitsuba
def test_submit_wait_and_fetch(server: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["submit", *ASKED, "--server", server, "--wait", "--json"]) == 0
    done = said(capsys)
    assert done["state"] == "done"
    assert [cell["state"] for cell in done["cells"]] == ["done", "done"]
    assert run(["submit", *ASKED, "--server", server, "--json"]) == 0
    assert said(capsys)["id"] == done["id"]
    assert run(["status", "--server", server, "--json"]) == 0
    assert [item["id"] for item in said(capsys)] == [done["id"]]
    out = tmp_path / "report"
    assert run(["fetch", done["id"], "--server", server, "--out", str(out), "--json"]) == 0
    assert said(capsys)["files"] == len([p for p in out.rglob("*") if p.is_file()])
    assert {"index.html", "results.csv", "evaluation.json", "assets", "images", "results", "references"} <= {
        p.name for p in out.iterdir()
    }
    rows = httpx.get(f"{server}/v1/evaluations/{done['id']}/results").json()["results"]
    assert [row["settings"]["level"] for row in rows] == [0.25, 0.5]
    metrics = httpx.get(f"{server}/metrics").text
    assert 'luxmeter_method_seconds_total{method="flat",stage="render"}' in metrics
    assert run(["retry", done["id"], "--server", server, "--json"]) == 1
    assert "only failed and cancelled" in said(capsys)["error"]


def test_cancel(server: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run(["submit", "--scene", "corner", "--method", "flat", "--set", "flat.mode=hang", "--size", "8x6", "--server", server])
        == 0
    )
    id = capsys.readouterr().out.strip()
    assert run(["cancel", id, "--server", server, "--json"]) == 0
    assert said(capsys)["state"] == "cancelled"
    assert run(["cancel", "0000000000000000", "--server", server]) == 2
    assert "no evaluation" in capsys.readouterr().err


def test_other_machines_need_a_token(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["serve", "--host", "0.0.0.0", "--port", "0"]) == 2
    assert "luxmeter token add" in capsys.readouterr().err


def test_token_commands(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["token", "add", "nightly", "--scope", "read", "--json"]) == 0
    made = said(capsys)
    kept = TokenStore().find(made["token"])
    assert kept is not None
    assert (kept.name, kept.scope) == ("nightly", "read")
    assert run(["token", "list", "--json"]) == 0
    assert said(capsys) == [{key: made[key] for key in ("id", "name", "scope", "created")}]
    assert run(["token", "revoke", made["id"]]) == 0
    assert TokenStore().all() == ()
    assert run(["token", "revoke", made["id"]]) == 2
    assert run(["token", "add", "x", "--scope", "root"]) == 2


def test_a_server_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["status", "--server", "http://127.0.0.1:1"]) == 1
    assert "127.0.0.1:1" in capsys.readouterr().err
    assert run(["status", "--server", "nonsense"]) == 2
