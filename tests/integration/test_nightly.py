"""`luxmeter nightly`, `compare` and `accept`, with evaluations that cost nothing in place of rendered ones."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly_folders import change_images, fail
from report_evaluation import make
from test_report_write import Links, digest

from jobs import Plan
from jobs.store import Store
from renderers import registered_methods
from reports.folder import Evaluation, read
from reports.runs import accepted, history
from service.cli import run
from service.suite import DEFAULT, load

SUITE = """
name = "small"
[defaults]
size = [32, 24]
seeds = 4
[part.one]
scenes = ["cornell-box"]
methods = [{ name = "ir", settings = { vpls = 16 } }]
[part.two]
scenes = ["cornell-box"]
methods = [{ name = "pt", settings = { spp = 1 } }]
"""


class Renderer:
    """Stands in for `jobs.evaluate`: writes a synthetic folder, disturbed as told."""

    def __init__(self) -> None:
        self.disturb: Any = lambda folder: None
        self.interrupted = False

    def __call__(self, plan: Plan, folder: Path, options: Any, notify: Any) -> Evaluation:
        make(folder, methods=2, seeds=plan.request.seeds)
        self.disturb(folder)
        evaluation, _ = read(folder)
        if self.interrupted:
            evaluation.cells[0].state = "cancelled"
        return evaluation


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch) -> Renderer:
    found = Renderer()
    monkeypatch.setattr("service.commands._nightly.carry_out", found)
    return found


@pytest.fixture
def suite(tmp_path: Path) -> str:
    (tmp_path / "small.toml").write_text(SUITE)
    return str(tmp_path / "small.toml")


def nightly(suite: str, out: Path, *more: str) -> int:
    return run(["nightly", "--suite", suite, "--out", str(out), "--quiet", *more])


def brighter(folder: Path) -> None:
    change_images(folder, "*-1-ir-*", lambda image: image * 1.06)


def test_first_run_accept_repeat_regression(
    suite: str, home: Path, renderer: Renderer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert nightly(suite, tmp_path / "first") == 0
    assert "No run has been accepted yet" in capsys.readouterr().out
    assert run(["accept", str(tmp_path / "first"), "--json"]) == 0
    pointer = json.loads(capsys.readouterr().out)
    assert pointer == accepted(home, "small").model_dump()
    assert nightly(suite, tmp_path / "second", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["comparison"]["counts"] == {"unchanged": 4}
    assert document["run"]["baseline"] == "first"
    assert f"luxmeter accept {tmp_path / 'second'}" in (tmp_path / "second" / "index.html").read_text()
    renderer.disturb = brighter
    assert nightly(suite, tmp_path / "third") == 1
    said = capsys.readouterr().out
    assert "2 of 4 rows got worse beyond noise" in said
    assert said.rstrip().endswith(str(tmp_path / "third" / "index.html"))
    assert json.loads((tmp_path / "third" / "run.json").read_text())["regressed"] is True


def test_runs_are_dated_and_make_a_history(suite: str, home: Path, renderer: Renderer, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["nightly", "--suite", suite, "--json", "--quiet"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d-\d\d-\d\dZ", document["run"]["id"])
    assert Path(document["folder"]).parent == home / "nightly" / "runs"
    assert [r.model_dump() for r in history(home)] == [document["run"]]
    assert history(home / "nowhere") == []
    assert run(["accept", document["run"]["id"]]) == 0
    assert accepted(home, "small").id == document["run"]["id"]
    assert run(["compare", document["run"]["id"], document["run"]["id"]]) == 0


def test_page_is_a_pure_function_of_the_folders_and_whole(suite: str, home: Path, renderer: Renderer, tmp_path: Path) -> None:
    a, b = tmp_path / "a", tmp_path / "b"
    assert nightly(suite, a) == 0
    renderer.disturb = brighter
    assert nightly(suite, b) == 0  # nothing is accepted, so nothing can be worse
    pages = [tmp_path / "page", tmp_path / "again"]
    for page in pages:
        assert run(["compare", str(a), str(b), "--out", str(page)]) == 1
    assert digest(pages[0]) == digest(pages[1])
    links = Links()
    links.feed((pages[0] / "index.html").read_text())
    assert links.open == []
    assert len(set(links.ids)) == len(links.ids)
    for target in links.targets:
        if target.startswith("#"):
            assert target[1:] in links.ids
        elif not target.startswith("data:"):
            assert (pages[0] / target).is_file(), target


def test_images_of_both_runs_stand_side_by_side(suite: str, home: Path, renderer: Renderer, tmp_path: Path) -> None:
    assert nightly(suite, tmp_path / "a") == 0
    renderer.disturb = brighter
    assert nightly(suite, tmp_path / "b") == 0
    assert run(["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(tmp_path / "page")]) == 1
    page = (tmp_path / "page" / "index.html").read_text()
    data = json.loads(re.search(r'id="c0-data">(.*?)</script>', page, re.S)[1])
    after, before, reference = data["frames"][0]["images"]
    assert [i["label"] for i in (after, before)] == ["after, seed 0", "before, seed 0"]
    assert reference["kind"] == "reference"
    assert after["matched"] == before["id"]  # the viewer opens on these two
    for image in (after, before, reference):
        assert (tmp_path / "page" / "assets" / "data" / f"{image['id']}.js").is_file()


def test_an_altered_baseline_is_refused(
    suite: str, home: Path, renderer: Renderer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert nightly(suite, tmp_path / "first") == 0
    assert run(["accept", str(tmp_path / "first")]) == 0
    brighter(tmp_path / "first" / "one")
    assert nightly(suite, tmp_path / "second") == 2
    assert "was altered since it was accepted" in capsys.readouterr().err
    assert run(["accept", str(tmp_path / "first")]) == 2
    assert "was altered after the run" in capsys.readouterr().err
    assert not (tmp_path / "second").exists()


def test_failed_cells_fail_the_run_until_they_are_accepted(suite: str, home: Path, renderer: Renderer, tmp_path: Path) -> None:
    renderer.disturb = lambda folder: fail(folder, "*-0-ir-s1-*")
    assert nightly(suite, tmp_path / "first") == 1
    assert run(["accept", str(tmp_path / "first")]) == 0
    assert nightly(suite, tmp_path / "second") == 0
    renderer.disturb = lambda folder: fail(folder, "*-?-ir-s1-*")
    assert nightly(suite, tmp_path / "third") == 1


def test_an_interrupted_run_leaves_nothing(suite: str, home: Path, renderer: Renderer, tmp_path: Path) -> None:
    renderer.interrupted = True
    assert nightly(suite, tmp_path / "first") == 130
    assert sorted(p.name for p in tmp_path.iterdir()) == ["home", "small.toml"]


class Hook(BaseHTTPRequestHandler):
    """Keeps what is posted."""

    def do_POST(self) -> None:
        self.server.got = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(self.server.answer)
        self.end_headers()

    def log_message(self, *args: object) -> None:
        pass


@pytest.fixture
def hook() -> Iterator[HTTPServer]:
    server = HTTPServer(("127.0.0.1", 0), Hook)
    server.got, server.answer = None, 204
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def test_webhook_gets_the_outcome(suite: str, home: Path, renderer: Renderer, tmp_path: Path, hook: HTTPServer) -> None:
    url = f"http://127.0.0.1:{hook.server_port}/hook"
    assert nightly(suite, tmp_path / "first", "--webhook", url) == 0
    assert "No run has been accepted" in hook.got["text"]
    assert run(["accept", str(tmp_path / "first")]) == 0
    renderer.disturb = brighter
    assert nightly(suite, tmp_path / "second", "--webhook", url) == 1
    assert [row["verdict"] for row in hook.got["rows"]] == ["regression", "regression"]
    assert hook.got["run"]["baseline"] == "first"


def test_a_failing_webhook_changes_nothing_else(
    suite: str, home: Path, renderer: Renderer, tmp_path: Path, hook: HTTPServer, capsys: pytest.CaptureFixture[str]
) -> None:
    hook.answer = 500
    assert nightly(suite, tmp_path / "first", "--webhook", f"http://127.0.0.1:{hook.server_port}/") == 0
    assert "the webhook was not reached" in capsys.readouterr().err
    hook.server_close()
    assert nightly(suite, tmp_path / "second", "--webhook", "http://127.0.0.1:9/") == 0
    assert nightly(suite, tmp_path / "third", "--webhook", "file:///etc/passwd") == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = [", "is not TOML"),
        ('name = "A b"\n[part.one]\nscenes=["cornell-box"]\nmethods=[]', "small letters"),
        ('name = "a"', "part"),
        ('name = "a"\n[part.one]\nscenes=["cornell-box"]\nmethods=[]', "part one: methods"),
        ('name = "a"\n[part.one]\nscenes=["cornell-box"]\nmethods=[{name="ir", settings={vpls=0}}]', "part one: "),
        ('name = "a"\n[part.one]\nscenes=["cornell-box"]\nmethods=[{name="ir", settings={vpl=1}}]', "part one: "),
        ('name = "a"\nextra = 1\n[part.one]\nscenes=["cornell-box"]\nmethods=[{name="ir"}]', "extra"),
    ],
)
def test_a_wrong_suite_is_refused_in_one_line(
    text: str, said: str, home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.toml").write_text(text)
    assert nightly(str(tmp_path / "bad.toml"), tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_refusals_name_what_is_missing(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert nightly(str(tmp_path / "none.toml"), tmp_path / "out") == 2
    assert run(["compare", str(tmp_path / "x"), str(tmp_path)]) == 2
    assert "no folder" in capsys.readouterr().err
    assert run(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert "holds no evaluation" in capsys.readouterr().err
    assert run(["accept", str(tmp_path)]) == 2
    assert "no run.json" in capsys.readouterr().err


def test_the_nightly_suite_plans_and_has_seeds_enough() -> None:
    suite = load(DEFAULT)
    plans = suite.plans()
    assert not any(plan.refused for plan in plans.values())
    assert min(plan.request.seeds for plan in plans.values()) >= 4


def test_the_nightly_suite_renders_every_method() -> None:
    """Whoever adds a method adds it to the suite: what no night renders may break unseen."""
    wanted = {method.name for plan in load(DEFAULT).plans().values() for method in plan.request.methods}
    ours = {name for name, method in registered_methods().items() if type(method).__module__.startswith("renderers.methods.")}
    assert ours - wanted == set()


@pytest.mark.gl
@pytest.mark.mitsuba
@pytest.mark.slow
def test_two_nights_of_real_renders_have_the_same_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tiny.toml").write_text(
        'name = "tiny"\n[defaults]\nsize = [16, 12]\nnoise = 0.2\nseeds = 2\n[part.one]\nscenes = ["cornell-box"]\n'
        'methods = [{ name = "pt", settings = { spp = 4 } }, { name = "ir", settings = { vpls = 16 } }]\n'
    )
    assert nightly(str(tmp_path / "tiny.toml"), tmp_path / "a") == 0
    assert run(["accept", str(tmp_path / "a")]) == 0
    capsys.readouterr()
    assert nightly(str(tmp_path / "tiny.toml"), tmp_path / "b", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["comparison"]["counts"] == {"unchanged": 2}
    assert document["comparison"]["references"] == []
    assert Store().home.is_dir()
    images = [next((tmp_path / run / "one" / "images").iterdir()).read_bytes() for run in "ab"]
    assert np.array_equal(*[np.frombuffer(i, np.uint8) for i in images])
