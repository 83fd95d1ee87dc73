"""The parts of claims on forward light cuts that need no render."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.claims import held, registered_claims
from jobs.claims.bench import display_rmse
from jobs.claims.flc_contours import contour
from jobs.claims.flc_pipeline import CASES, FIGURE, case_rows, faster, figure_rows, milliseconds, saturated
from renderers import Frame
from renderers.frame import Timing

PRINTED = {tiles: [seconds] * 3 for tiles, seconds in FIGURE.items()}


def frame(**wall: float) -> Frame:
    layer = np.zeros((1, 1, 3), np.float32)
    return Frame({"beauty": layer}, tuple(Timing(name, seconds, seconds) for name, seconds in wall.items()))


def test_the_printed_figure_holds_what_its_text_says() -> None:
    assert all(saturated(PRINTED))
    assert all(faster(PRINTED))
    rows = {r.id: r for r in figure_rows(PRINTED, {t: [0.0] for t in FIGURE})}
    assert rows["tiles_16.speedup"].measured.mean == rows["tiles_16.speedup"].published == pytest.approx(93 / 33)
    assert rows["more_tiles_faster"].verdict == rows["last_step_small"].verdict == "reproduced"
    assert rows["tiles_4.frame_ms"].verdict == "not comparable"


def test_times_that_never_fall_deviate() -> None:
    flat = {tiles: [10.0, 10.0] for tiles in FIGURE}
    rows = {r.id: r for r in figure_rows(flat, {t: [0.0] for t in FIGURE})}
    assert rows["more_tiles_faster"].verdict == "deviates"


def test_columns_of_the_table_sum_up_and_so_do_ours() -> None:
    for case in CASES:
        # printed to a millisecond; the publication says that a frame has passes besides
        assert case.direct + case.indirect <= case.frame
    made = frame(gbuffer=0.001, direct=0.002, vpls=0.003, splat=0.004)
    measured = {r.id: r.measured.mean for r in case_rows(CASES[0], [made, made])}
    assert measured["sponza.frame_ms"] == pytest.approx(measured["sponza.direct_ms"] + measured["sponza.indirect_ms"]) == 10
    assert milliseconds(made, ("vpls",)) == pytest.approx(3)


def test_contours_are_steps_of_the_ratio_between_neighbours() -> None:
    whole = np.ones((1, 4, 3), np.float32)
    image = np.array([1.0, 1.0, 1.5, 1.5], np.float32)[None, :, None] * whole
    pairs = np.array([0, 1, 2]), np.array([1, 2, 3])
    assert contour(image, whole, pairs) == pytest.approx(0.5 / 3)
    assert contour(3 * whole, whole, pairs) == 0
    # the last pixel is too dark to count: one pair is lost
    dark = whole.copy()
    dark[0, 3] = 0.01
    assert contour(image, dark, pairs) == pytest.approx(0.25)


def test_words_are_shares_of_cases() -> None:
    assert held("a", "a", [True, True]).verdict == "reproduced"
    assert held("a", "a", [False, False]).verdict == "deviates"
    assert held("a", "a", [True, False]).measured.mean == 0.5
    with pytest.raises(ValueError, match="no values"):
        held("a", "a", [])


def test_rmse_is_of_display_values() -> None:
    black, white = np.zeros((2, 2, 3), np.float32), np.full((2, 2, 3), 0.5, np.float32)
    assert display_rmse(white, black, 2.0) == pytest.approx(255)
    assert display_rmse(white, 3 * white, 2.0) == 0


def test_the_claims_are_registered() -> None:
    ids = {"flc-table-4.1", "flc-table-4.2", "flc-table-5.2", "flc-table-5.3", "flc-fig-4.7", "flc-fig-5.10"}
    assert ids <= set(registered_claims())
