"""`luxmeter reproduce`: documents, exit codes, refusals; with claims that take no time."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from service.cli import run

PLUGINS = Path(__file__).parents[1] / "plugins"
pytestmark = pytest.mark.gl


@pytest.fixture(autouse=True)
def _toy_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(PLUGINS), *filter(None, [os.environ.get("PYTHONPATH")])]))
    monkeypatch.setenv("LUXMETER_PLUGINS", "toy_claims")


def test_the_document(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "toy-true", "toy-true", "--json"]) == 0
    out, err = capfd.readouterr()
    (answer,) = json.loads(out)
    assert list(answer) == ["claim", "status", "why", "scene", "device", "command", "rows"]
    assert answer["device"].count(" · ") == 2
    del answer["device"]
    figures = {"published": 1.0, "measured": 1.0, "low": 1.0, "high": 1.0}
    assert answer == {
        "claim": "toy-true",
        "status": "reproduced",
        "why": "1 of 1 compared figures hold. counted by hand.",
        "scene": "a toy",
        "command": "luxmeter reproduce toy-true",
        "rows": [{"id": "one.count", "quantity": "number of ones", "unit": "1", **figures}],
    }
    assert "toy-true (1 of 1): Toy claim that holds" in err


def test_published_and_measured_side_by_side(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "toy-true", "--quiet"]) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert out.startswith("toy-true: reproduced\n")
    assert out.split()[-7:] == ["of", "ones", "1", "1", "1", "1", "1"]


def test_a_claim_without_an_answer_costs_the_exit_code_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "toy-broken", "toy-endless", "toy-true", "--timeout", "8", "--json"]) == 1
    out, err = capfd.readouterr()
    assert [answer["claim"] for answer in json.loads(out)] == ["toy-true"]
    assert "toy-broken: not answered: ValueError: no such table" in err
    assert "toy-endless: not answered: took longer than 8 s" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "which claim? --all, or some of flc-"),
        (["nosuch"], "unknown claim 'nosuch'; known: flc-"),
        (["toy-true", "--all"], "not both"),
    ],
)
def test_refusals(arguments: list[str], message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", *arguments, "--json"]) == 2
    out, err = capfd.readouterr()
    assert message in json.loads(out)["error"]
    assert err.count("\n") == 1


def test_the_list_measures_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "--list", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert {"claim": "toy-true", "title": "Toy claim that holds", "source": "luxmeter's tests"} in found
    assert run(["reproduce", "--list"]) == 0
    assert "flc-table-4.1" in capfd.readouterr().out
