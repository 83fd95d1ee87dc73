"""The service's pages in headless Chromium: submit, watch, read the report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browsers import watched
from http_nights import FIRST, SECOND, two_nights
from http_service import HEALTHY, FakeQueue, serving
from report_evaluation import make
from test_http_uploads import GOOD

import reports
from jobs.request import ReferenceFrames
from service.http.app import create_app
from service.http.settings import ServerSettings
from service.tokens import TokenStore

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("toy_methods")]
PATHS = ("/", "/submit", "/scenes", "/methods", "/methods/flat", "/compare", "/problems", "/login")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make(tmp_path_factory.mktemp("evaluation"), methods=2, seeds=2, noise=0.01)
    reports.write(made)
    return made


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for all tests, so that a preview is drawn once."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture
def queue() -> FakeQueue:
    return FakeQueue()


@pytest.fixture
def address(queue: FakeQueue, home: Path, monkeypatch: pytest.MonkeyPatch, toy_methods: None) -> Iterator[str]:
    monkeypatch.setenv("LUXMETER_HOME", str(home))
    settings = ServerSettings(home=home, requests_per_s=0, submissions_per_s=0, poll_s=0.05)
    with serving(create_app(queue, settings, machine=lambda: HEALTHY)) as found:
        yield found


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    with watched(browser, address, base_url=address) as opened:
        yield opened


def test_submit_watch_and_read_the_report(page: Any, queue: FakeQueue, report: Path) -> None:
    page.goto("/")
    assert "Nothing has been evaluated yet" in page.inner_text("main")
    page.click("text=New evaluation")
    page.check("[name=method][value=flat]")
    page.fill("[id='flat.level']", "0.25, 0.5")
    page.fill("#seeds", "2")
    page.fill("#width", "8")
    page.fill("#height", "6")
    assert page.inner_text("#count") == "4 renders"
    page.click("button.primary")
    page.wait_for_url("**/evaluations/*")
    (id,) = queue.found
    status = queue.found[id]
    assert [(c.label, c.seed, c.width) for c in status.cells] == [(f"flat level={v}", s, 8) for v in (0.25, 0.5) for s in (0, 1)]
    squares = ".matrix .cell"
    assert page.locator(squares).all_inner_texts() == ["0 of 2", "0 of 2"]
    queue.set(id, "done", only=0)
    page.wait_for_function("() => document.querySelector('.matrix .cell')?.textContent === '1 of 2'")
    queue.folders[id] = report
    queue.set(id, "done")
    page.wait_for_selector("text=Report")
    assert page.locator(squares).all_inner_texts() == ["2 of 2", "2 of 2"]
    page.click(".actions >> text=Report")
    page.wait_for_url("**/report/")
    assert "Speed against error" in page.inner_text("h1")
    page.locator(".viewer").first.scroll_into_view_if_needed()
    page.wait_for_function("() => document.querySelector('.viewer .key')?.textContent.includes('left A')")
    page.goto(f"/v1/evaluations/{id}/report")
    page.wait_for_function(
        "() => document.readyState === 'complete' && getComputedStyle(document.querySelector('.brand')).fontWeight === '600'"
    )
    assert page.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")


def test_a_request_can_be_changed_and_submitted_again(page: Any, queue: FakeQueue) -> None:
    page.goto("/submit")
    page.check("[name=method][value=flat]")
    page.fill("[id='flat.level']", "0.25, 0.5")
    page.fill("#more", "cornell-box:light=area")
    page.click("button.primary")
    page.wait_for_url("**/evaluations/*")
    page.click("text=Change and submit")
    page.wait_for_url("**/submit#*")
    assert page.input_value("[id='flat.level']") == "0.25, 0.5"
    assert page.input_value("#more") == "cornell-box:light=area"
    assert page.is_checked("[name=scene][value=cornell-box]")
    page.fill("#seeds", "3")
    page.click("button.primary")
    page.wait_for_url("**/evaluations/*")
    assert len(queue.found) == 2


def test_a_sequence_says_which_frames_get_references(page: Any, queue: FakeQueue) -> None:
    page.goto("/submit")
    page.check("[name=method][value=flat]")
    page.fill("#last", "39")
    page.fill("#references", "10, 0:5, 5,")
    page.click("button.primary")
    assert page.evaluate("document.getElementById('references').validity.patternMismatch")
    assert not queue.found
    for text, expected in (
        ("10, 0:5,20:25", ReferenceFrames(every=10, windows=[(0, 5), (20, 25)])),
        ("all", ReferenceFrames(every=1)),
    ):
        page.fill("#references", text)
        page.click("button.primary")
        page.wait_for_url("**/evaluations/*")
        assert list(queue.found.values())[-1].request.references == expected
        page.click("text=Change and submit")
        page.wait_for_url("**/submit#*")
        assert page.input_value("#references") == {"all": "1"}.get(text, "10, 0:5, 20:25")
    page.fill("#references", "")
    page.fill("#last", "38")
    page.click("button.primary")
    page.wait_for_url("**/evaluations/*")
    assert list(queue.found.values())[-1].request.references is None


def test_cancel_and_retry_buttons(page: Any, queue: FakeQueue) -> None:
    page.goto("/submit")
    page.check("[name=method][value=flat]")
    page.click("button.primary")
    page.wait_for_url("**/evaluations/*")
    (id,) = queue.found
    page.click("[data-do=cancel]")
    page.wait_for_selector("[data-do=retry]")
    assert queue.found[id].state == "cancelled"
    page.click("[data-do=retry]")
    page.wait_for_selector("[data-do=cancel]")
    assert queue.found[id].state == "queued"


def test_a_wrong_setting_is_told_in_the_form(browser: Any, address: str) -> None:
    page = browser.new_page(base_url=address)
    page.goto("/submit")
    page.check("[name=method][value=flat]")
    page.fill("[id='flat.level']", "11")
    page.click("button.primary")
    page.wait_for_selector("#problem:not([hidden])")
    assert "flat.level" in page.inner_text("#problem")
    page.close()


def test_a_scene_can_be_uploaded(page: Any) -> None:
    page.goto("/scenes")
    page.set_input_files("#file", {"name": "floor.glb", "mimeType": "model/gltf-binary", "buffer": GOOD})
    page.click("text=Upload")
    page.wait_for_selector(".card:target")
    assert "floor" in page.inner_text(".card:target h2")


def test_pages_work_by_keyboard(page: Any, queue: FakeQueue) -> None:
    page.goto("/submit")
    page.focus("[name=method][value=flat]")
    page.keyboard.press("Space")
    page.focus("#seeds")
    page.keyboard.press("Control+a")
    page.keyboard.type("2")
    page.keyboard.press("Enter")
    page.wait_for_url("**/evaluations/*")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    assert len(queue.found) == 1


@pytest.fixture(scope="module")
def nights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with two nightly runs."""
    home = tmp_path_factory.mktemp("nights")
    two_nights(home)
    return home


def test_what_changed_over_night(browser: Any, nights: Path) -> None:
    app = create_app(FakeQueue(), ServerSettings(home=nights, requests_per_s=0, submissions_per_s=0), machine=lambda: HEALTHY)
    with serving(app) as address, watched(browser, address, base_url=address) as page:
        page.goto("/")
        page.click(f"text={SECOND}")
        page.wait_for_selector("table[aria-label=Changes]")
        assert page.inner_text(".outcome") == "1 of 3 rows got worse beyond noise."
        assert page.input_value("#a") == FIRST
        assert page.input_value("#b") == SECOND
        assert f"luxmeter accept {SECOND}" in page.inner_text("pre.command")
        change = page.locator("section.change").first
        assert "regression" in change.inner_text()
        assert "rays" in change.inner_text()
        assert page.evaluate("[...document.querySelectorAll('.strip')].map(s => s.querySelectorAll('img').length)") == [4]
        change.locator(".strip").scroll_into_view_if_needed()
        page.wait_for_function("() => [...document.images].every(i => i.complete && i.naturalWidth === 32)")
        page.click("text=Compare pixel by pixel")
        page.wait_for_function("() => document.querySelector('.viewer .key')?.textContent.includes('left A: after')")
        page.click("[data-mode=relative]")
        page.wait_for_function("() => document.querySelector('.viewer .key')?.textContent.includes('A brighter than B')")
        page.click("text=Swap")
        page.wait_for_url(f"**/compare?a={SECOND}&b={FIRST}")
        assert page.input_value("#a") == SECOND
        page.select_option("#a", "")
        page.click("button.primary")
        page.wait_for_selector("text=No run has been accepted yet")
        for width in (360, 1280):
            page.set_viewport_size({"width": width, "height": 800})
            page.goto(f"/compare?b={SECOND}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            # Every figure of the summary can be read without scrolling sideways.
            figures = page.locator("table[aria-label=Changes] td").all()
            assert max(box["x"] + box["width"] for box in (cell.bounding_box() for cell in figures)) <= width


@pytest.mark.parametrize("width", [360, 1280])
def test_no_page_is_wider_than_the_screen(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    for path in PATHS:
        page.goto(path, wait_until="domcontentloaded")  # not "load": that waits for the previews of all scenes
        page.wait_for_function("() => [...document.querySelectorAll('link[rel=stylesheet]')].every(e => e.sheet)")
        assert page.evaluate("document.documentElement.scrollWidth") <= width, path
        assert page.evaluate(
            "[...document.querySelectorAll('input:not([type=hidden]), select')].every(e => e.labels.length > 0)"
        ), path


def test_login_in_the_browser(browser: Any, tmp_path: Path) -> None:
    _, secret = TokenStore(tmp_path / "tokens.json").add("someone", "submit")
    settings = ServerSettings(home=tmp_path, require_token=True, requests_per_s=0, submissions_per_s=0)
    with serving(create_app(FakeQueue(), settings, machine=lambda: HEALTHY)) as address:
        page = browser.new_page(base_url=address)
        page.goto("/methods")
        page.fill("#token", secret)
        page.keyboard.press("Enter")
        page.wait_for_url("**/methods")
        assert "flat" in page.inner_text("table")
        page.click("text=Log out")
        page.wait_for_url("**/login")
        page.close()
