"""The report in headless Chromium, opened from disk."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import watched
from report_evaluation import make

import reports
from renderers.images import display_values, read_exr
from reports.metrics import OVER, UNDECIDED, Pair, over_states, signed_relative_error

pytestmark = pytest.mark.browser

PROBE = (5, 3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make(
        tmp_path_factory.mktemp("evaluation"), scenes=2, methods=4, seeds=2, failing=frozenset((1, m) for m in range(4)), noise=0.01
    )
    reports.write(made)
    return made


@pytest.fixture
def page(browser: Any, folder: Path) -> Iterator[Any]:
    with watched(browser, "file:", device_scale_factor=1) as opened:
        opened.goto((folder / "index.html").as_uri())
        yield opened


def open_viewer(page: Any) -> Any:
    canvas = page.locator("#s0 .viewer canvas")
    page.locator("#s0 .viewer").scroll_into_view_if_needed()
    canvas.wait_for()
    page.wait_for_function("document.querySelector('#s0 .viewer .key').textContent.includes('left A')")
    return canvas


def probe(page: Any, canvas: Any) -> None:
    """Move the probed pixel from the middle of the 32×24 image to PROBE by keyboard alone."""
    canvas.focus()
    for key, times in (("ArrowLeft", 16 - PROBE[0]), ("ArrowUp", 12 - PROBE[1])):
        for _ in range(times):
            page.keyboard.press(key)


def canvas_pixel(page: Any, x: int, y: int, panes: int = 1) -> list[int]:
    """Colour in the middle of image pixel (x, y) of the left pane."""
    return list(
        page.evaluate(
            """([x, y, panes]) => { const c = document.querySelector('#s0 .viewer canvas');
            return [...c.getContext('2d').getImageData(Math.floor((x + .5) * c.width / panes / 32),
                Math.floor((y + .5) * c.height / 24), 1, 1).data].slice(0, 3); }""",
            [x, y, panes],
        )
    )


def stored(folder: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    image = read_exr(folder / "images" / "cornell-box-0-ir-s0-f0.exr")[0]["beauty"]
    return image, read_exr(folder / "references" / "cornell-box-one-bounce-f0-centre.exr")[0]


def pair(folder: Path) -> Pair:
    image, reference = stored(folder)
    exposure = reports.folder.read(folder)[0].scenes[0].exposure
    return Pair(image, reference["mean"], exposure, reference["luminance_variance"], 16)


def test_read_out_is_the_exr_float(page: Any, folder: Path) -> None:
    probe(page, open_viewer(page))
    image, reference = stored(folder)
    x, y = PROBE
    for side, pixels in (("a", image), ("b", reference["mean"])):
        shown = page.locator(f"#s0 [data-pixel={side}]").inner_text().split()
        assert np.array_equal(np.array(shown, np.float32), pixels[y, x])
    shown_error = float(page.locator("#s0 [data-error]").inner_text().removesuffix("%"))
    assert shown_error == pytest.approx(100 * signed_relative_error(pair(folder))[y, x], abs=0.0051)


def test_canvas_shows_the_tone_mapped_image_and_exposure(page: Any, folder: Path) -> None:
    canvas = open_viewer(page)
    image, _ = stored(folder)
    exposure = reports.folder.read(folder)[0].scenes[0].exposure
    assert canvas_pixel(page, 20, 9, panes=2) == pytest.approx(list(display_values(image, exposure)[9, 20]), abs=1)
    canvas.focus()
    for _ in range(4):
        page.keyboard.press("[")
    assert page.locator("#s0 input[name=exposure]").input_value() == "-1"
    assert canvas_pixel(page, 20, 9, panes=2) == pytest.approx(list(display_values(image, exposure / 2)[9, 20]), abs=1)


def test_over_map_has_three_colours(page: Any, folder: Path) -> None:
    open_viewer(page)
    page.locator("#s0 [data-mode=over]").click()
    states = over_states(pair(folder))
    colours = {0: [38, 44, 56], OVER: [213, 94, 0], UNDECIDED: [86, 180, 233]}
    assert set(np.unique(states)) == set(colours)
    for state, colour in colours.items():
        y, x = (int(v) for v in np.argwhere(states == state)[0])
        assert canvas_pixel(page, x, y) == colour
    assert "undecided" in page.locator("#s0 .key").inner_text()


def test_flip_and_slider(page: Any, folder: Path) -> None:
    canvas = open_viewer(page)
    canvas.focus()
    page.keyboard.press("3")
    assert "showing A" in page.locator("#s0 .key").inner_text()
    page.keyboard.press("f")
    assert "showing B" in page.locator("#s0 .key").inner_text()
    page.mouse.move(2, 2)
    canvas.hover()
    assert "showing B" in page.locator("#s0 .key").inner_text()
    page.mouse.move(2, 2)
    assert "showing A" in page.locator("#s0 .key").inner_text()
    page.keyboard.press("2")
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
    image, reference = stored(folder)
    exposure = reports.folder.read(folder)[0].scenes[0].exposure
    assert canvas_pixel(page, 4, 20) == pytest.approx(list(display_values(image, exposure)[20, 4]), abs=1)
    assert canvas_pixel(page, 28, 20) == pytest.approx(list(display_values(reference["mean"], exposure)[20, 28]), abs=1)


def test_diagnostic_pictures_stand_under_the_image_they_belong_to(page: Any) -> None:
    open_viewer(page)
    pictures = page.locator("#s0 .pictures figure")
    assert pictures.count() == 1
    assert pictures.inner_text() == "ir vpls=1024: light paths where <virtual> lights lie"
    assert pictures.locator("img").evaluate("async i => { await i.decode(); return [i.naturalWidth, i.naturalHeight]; }") == [
        32,
        24,
    ]
    page.locator("#s0 select[name=aSelect]").select_option(label="flc")
    page.wait_for_function("document.querySelector('#s0 .viewer .key').textContent.includes('left A: flc')")
    assert pictures.count() == 0


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make(tmp_path_factory.mktemp("sequence"), methods=3, frames=7, compared=frozenset({0, 1, 2, 5}))
    reports.write(made)
    return made


def test_a_slider_walks_through_the_compared_frames(browser: Any, sequence: Path) -> None:
    opened = browser.new_page(viewport={"width": 1280, "height": 900})
    opened.goto((sequence / "index.html").as_uri())
    open_viewer(opened)
    slider, shown = opened.locator("#s0 input[name=frame]"), opened.locator("#s0 output.frame")
    assert [shown.inner_text(), slider.get_attribute("max")] == ["0", "3"]
    slider.focus()
    for expected in ("1", "2", "5"):
        opened.keyboard.press("ArrowRight")
        assert shown.inner_text() == expected
    opened.wait_for_function("document.querySelector('#s0 .pictures img').src.endsWith('-f5.light-paths.png')")
    assert opened.locator("#s0 select[name=aSelect]").input_value().endswith("-f5")
    opened.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_sequence_fits_a_telephone(browser: Any, sequence: Path, scheme: str) -> None:
    opened = browser.new_page(viewport={"width": 360, "height": 800}, color_scheme=scheme)
    opened.goto((sequence / "index.html").as_uri())
    widths = opened.evaluate("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    assert widths[0] <= widths[1]
    pictures = opened.locator(".panels img, .preview img, .worst img")
    assert pictures.count() == 4 + 1 + 3 * 3
    for index in range(pictures.count()):
        pictures.nth(index).scroll_into_view_if_needed()
        drawn = pictures.nth(index).evaluate("async i => { await i.decode(); return [i.naturalWidth, i.currentSrc]; }")
        assert drawn[0] > 0
        assert drawn[1].endswith(".svg") == (index < 4)
        assert index >= 4 or drawn[1].endswith(f"-{scheme}.svg")
    opened.close()


def test_zoom_keeps_the_probed_pixel_in_place(page: Any) -> None:
    canvas = open_viewer(page)
    page.locator("#s0 [data-mode=flip]").click()
    box = canvas.bounding_box()
    page.mouse.click(box["x"] + box["width"] * 0.7, box["y"] + box["height"] * 0.3)
    before = page.locator("#s0 .readout").inner_text()
    for _ in range(6):
        page.keyboard.press("+")
    page.mouse.move(box["x"] + box["width"] * 0.7 + 1, box["y"] + box["height"] * 0.3)
    assert page.locator("#s0 .readout").inner_text() == before


def test_tables_sort_both_ways(page: Any) -> None:
    table = page.locator("#s0 table.main")
    values = "t => [...t.tBodies[0].rows].map(r => Number(r.cells[2].dataset.value))"
    header = table.locator("thead tr:last-child th").nth(2)
    header.locator("button").focus()
    page.keyboard.press("Enter")
    rising = table.evaluate(values)
    assert rising == sorted(rising)
    assert len(set(rising)) > 1
    assert header.get_attribute("aria-sort") == "ascending"
    page.keyboard.press("Enter")
    assert table.evaluate(values) == rising[::-1]


def test_only_differences_hides_equal_settings(page: Any) -> None:
    details = page.locator("#s0 details", has=page.locator(".only-differences"))
    details.locator("summary").click()
    shown = "t => [...t.tBodies[0].rows].filter(r => r.offsetParent !== null).map(r => r.cells[0].textContent)"
    table = details.locator("table.settings")
    everything = table.evaluate(shown)
    assert {"vpls", "clamp", "levels", "accuracy"} <= set(everything)
    details.locator(".only-differences").check()
    assert table.evaluate(shown) == table.evaluate("t => [...t.querySelectorAll('tr.differs')].map(r => r.cells[0].textContent)")


def test_a_scene_whose_cells_all_failed(page: Any) -> None:
    text = page.locator("#s1").inner_text()
    assert "All cells failed." in text
    assert "UnsupportedScene" in text
    assert page.locator("#s1 .viewer").count() == 0
    assert page.locator("#s1 .failures tbody tr").count() == 4


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_on_both_pages(browser: Any, folder: Path, scheme: str) -> None:
    opened = browser.new_page(color_scheme=scheme)
    opened.goto((folder / "index.html").as_uri())
    colours = opened.evaluate(
        "['color', 'backgroundColor'].map(k => getComputedStyle(document.body)[k].match(/\\d+/g).map(Number))"
    )
    opened.close()
    light = []
    for colour in colours:
        linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in (c / 255 for c in colour[:3])]
        light.append(float(np.dot(linear, (0.2126, 0.7152, 0.0722))))
    # WCAG 2 contrast, level AAA.
    assert (max(light) + 0.05) / (min(light) + 0.05) > 7
