"""Nightly runs and comparisons over HTTP: the run history, verdicts, images, and what is refused."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from http_nights import FIRST, SECOND, two_nights
from http_service import HEALTHY, FakeQueue, serving
from PIL import Image
from report_evaluation import make
from test_http_api import FREE, problem, submitted

from reports.runs import runs_folder
from reports.viewer import write_difference
from service.http.app import create_app
from service.http.settings import ServerSettings

pytestmark = pytest.mark.usefixtures("toy_methods")


@pytest.fixture(scope="module")
def nights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("nights")
    two_nights(home)
    return home


@pytest.fixture(scope="module")
def compared(nights: Path) -> Iterator[httpx.Client]:
    """A service over a data folder of two nights; comparisons are made once for all tests."""
    with (
        serving(create_app(FakeQueue(), ServerSettings(home=nights, **FREE), machine=lambda: HEALTHY)) as address,
        httpx.Client(base_url=address, timeout=60) as found,
    ):
        yield found


@pytest.fixture
def queue() -> FakeQueue:
    return FakeQueue()


@pytest.fixture
def client(queue: FakeQueue, tmp_path: Path) -> Iterator[httpx.Client]:
    app = create_app(queue, ServerSettings(home=tmp_path / "home", **FREE), machine=lambda: HEALTHY)
    with serving(app) as address, httpx.Client(base_url=address, timeout=60) as found:
        yield found


def test_runs_of_another_version_are_left_out(nights: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    shutil.copytree(nights / "nightly", home / "nightly")
    for name, text in (("2027-01-01T03-00-00Z", '{"id": "x", "colour": 1}'), ("2027-01-02T03-00-00Z", "{"), ("other", "\x00")):
        (runs_folder(home) / name).mkdir()
        (runs_folder(home) / name / "run.json").write_text(text)
    (home / "nightly" / "accepted" / "nightly.json").write_text('{"id": 1}')
    app = create_app(FakeQueue(), ServerSettings(home=home, **FREE), machine=lambda: HEALTHY)
    with serving(app) as address, httpx.Client(base_url=address, timeout=60) as client:
        assert [(run["id"], run["accepted"]) for run in client.get("/v1/runs").json()["items"]] == [(SECOND, False), (FIRST, False)]
        for page in ("/", "/compare"):
            assert client.get(page).status_code == 200
            assert SECOND in client.get(page).text


def test_runs_are_listed_latest_first(compared: httpx.Client) -> None:
    page = compared.get("/v1/runs").json()
    assert [(run["id"], run["accepted"], run["regressed"]) for run in page["items"]] == [
        (SECOND, False, True), (FIRST, True, False),
    ]  # fmt: skip
    assert page["next_cursor"] is None
    first = compared.get("/v1/runs?limit=1").json()
    assert first["next_cursor"] == SECOND
    assert [run["id"] for run in compared.get(f"/v1/runs?limit=1&cursor={SECOND}").json()["items"]] == [FIRST]
    assert compared.get("/v1/runs?cursor=nosuch").json()["items"] == []


def test_the_latest_run_is_compared_with_the_accepted_one(compared: httpx.Client) -> None:
    found = compared.get("/v1/comparisons").json()
    assert (found["a"], found["b"], found["regressed"]) == (FIRST, SECOND, True)
    assert found["headline"] == "1 of 3 rows got worse beyond noise."
    gravest = found["rows"][0]
    assert (gravest["verdict"], gravest["label"], gravest["seeds"]) == ("regression", "ir vpls=1024", [0, 1, 2, 3, 4, 5])
    changes = {q["id"]: q for q in gravest["quantities"]}
    # The method was 3 % too dark: 3 % more energy is an improvement of the error, 20 % more work a regression.
    assert changes["matched.rmse"]["direction"] == "better"
    assert changes["matched.rmse"]["low"] < changes["matched.rmse"]["change"] < changes["matched.rmse"]["high"] < 0
    assert changes["counters.rays"]["relative"] == pytest.approx(0.2)
    assert changes["counters.rays"]["direction"] == "worse"
    assert changes["wall_s"]["kind"] == "information"
    assert [row["verdict"] for row in found["rows"][1:]] == ["unchanged"] * 2


def test_images_of_both_runs_and_their_difference(compared: httpx.Client) -> None:
    found = compared.get("/v1/comparisons").json()
    (shown,) = found["images"][found["rows"][0]["key"]]
    pictures = {}
    for name in ("before", "after", "difference", "reference"):
        answer = compared.get(shown[name])
        assert answer.headers["content-type"] == "image/png"
        pictures[name] = np.asarray(Image.open(io.BytesIO(answer.content)).convert("RGB"), float)
    assert {picture.shape for picture in pictures.values()} == {(24, 32, 3)}
    assert pictures["after"].mean() > pictures["before"].mean()
    # 3 % brighter everywhere: an eighth of the way from grey to orange, since the colours end at 25 %.
    assert np.median(pictures["difference"], (0, 1)) == pytest.approx([237, 223, 213], abs=2)
    for path in ("assets/../comparison.json", "comparison.json", "viewers.json", "assets/data/nosuch.js"):
        problem(compared.get(f"/v1/comparisons/{shown['before'].split('/')[3]}/{path}"), "not-found")


def test_sides_can_be_chosen(compared: httpx.Client) -> None:
    swapped = compared.get("/v1/comparisons", params={"a": SECOND, "b": FIRST}).json()
    assert (swapped["a"], swapped["b"]) == (SECOND, FIRST)
    changes = {q["id"]: q for q in swapped["rows"][0]["quantities"]}
    assert changes["counters.rays"]["direction"] == "better"
    assert compared.get("/v1/comparisons", params={"a": FIRST, "b": FIRST}).json()["counts"] == {"unchanged": 3}
    # The accepted run was compared with nothing.
    alone = compared.get("/v1/comparisons", params={"b": FIRST}).json()
    assert (alone["a"], alone["before"], alone["counts"]) == (None, None, {"new": 3})
    problem(compared.get("/v1/comparisons", params={"b": "nosuch"}), "not-found")
    problem(compared.get("/v1/comparisons", params={"b": ".."}), "not-found")
    problem(compared.get("/v1/comparisons", params={"b": "a/b"}), "validation-failed")


def test_an_altered_run_is_refused(nights: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    shutil.copytree(nights / "nightly" / "runs", runs_folder(home))
    path = next((runs_folder(home) / SECOND / "diffuse" / "results").glob("*.json"))
    path.write_text(path.read_text() + " ")
    with (
        serving(create_app(FakeQueue(), ServerSettings(home=home, **FREE), machine=lambda: HEALTHY)) as address,
        httpx.Client(base_url=address, timeout=60) as client,
    ):
        detail = problem(client.get("/v1/comparisons", params={"a": FIRST, "b": SECOND}), "conflict")["detail"]
    assert detail == f"the run {SECOND} was altered after it was made"
    assert [p.name for p in (home / "comparisons").iterdir()] == []


def test_without_any_night(client: httpx.Client) -> None:
    assert client.get("/v1/runs").json() == {"items": [], "next_cursor": None}
    problem(client.get("/v1/comparisons"), "not-found")
    assert "Nothing has been evaluated yet" in client.get("/compare").text


def test_evaluations_of_the_queue_can_be_compared(client: httpx.Client, queue: FakeQueue, tmp_path: Path) -> None:
    a, b = submitted(client), submitted(client, seeds=1)
    problem(client.get("/v1/comparisons", params={"a": a, "b": b}), "not-ready")
    queue.folders = {a: make(tmp_path / "a", methods=1, seeds=2), b: make(tmp_path / "b", methods=2, seeds=2)}
    for id in (a, b):
        queue.set(id, "done")
    found = client.get("/v1/comparisons", params={"a": a, "b": b}).json()
    assert found["counts"] == {"unchanged": 1, "new": 1}
    assert "name what" in problem(client.get("/v1/comparisons", params={"b": b}), "validation-failed")["detail"]


@pytest.mark.parametrize(("factor", "colour"), [(1.0, (242, 242, 242)), (0.5, (0, 90, 181)), (2.0, (200, 80, 0))])
def test_colours_of_a_difference(tmp_path: Path, factor: float, colour: tuple[int, int, int]) -> None:
    image = np.full((4, 6, 3), 0.5, np.float32)
    write_difference(tmp_path / "x.png", image * np.float32(factor), image)
    assert (np.asarray(Image.open(tmp_path / "x.png")) == colour).all()
    write_difference(tmp_path / "black.png", image * 0, image * 0)
    assert (np.asarray(Image.open(tmp_path / "black.png")) == 242).all()


def test_the_overview_tells_of_the_last_night(compared: httpx.Client) -> None:
    text = compared.get("/").text
    assert f'<a href="/compare?b={SECOND}">{SECOND}</a>' in text
    assert "1 regression" in text
