"""What a report shows of a sequence whose references lie in some of its frames."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from report_evaluation import make

import reports
from reports.folder import read
from reports.frame_plots import panels, runs
from reports.rows import gather
from reports.sequences import compared, series, worst
from reports.viewer import chosen_frames
from service.client import linked_files

COMPARED = frozenset({0, 1, 2, 5})
SIZE = (16, 12)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make(tmp_path_factory.mktemp("sequence"), methods=3, seeds=2, frames=7, size=SIZE, compared=COMPARED)
    reports.write(made)
    return made


def test_frames_without_a_reference_have_rows_without_metrics(folder: Path) -> None:
    table = pd.read_parquet(folder / "results.parquet")
    assert len(table) == 3 * 2 * 7
    missing = ~table["frame"].isin(COMPARED)
    assert (table["matched.rmse"].isna() == missing).all()
    assert (table["matched.flicker"].isna() == ~table["frame"].isin([1, 2])).all()
    assert table["wall_s"].notna().all()
    assert table["counters.rays"].notna().all()


def test_the_table_says_what_the_results_hold(folder: Path) -> None:
    table, page = pd.read_parquet(folder / "results.parquet"), (folder / "index.html").read_text()
    body = page[page.index("Over the frames") :]
    lines = re.findall(r"<tr data-row=.*?</tr>", body[: body.index("</table>")], re.S)
    assert len(lines) == 3
    for line in lines:
        label = re.search(r'<th scope="row" data-value="([^"]*)"', line)
        own = table[table["label"] == (label and label[1])]
        shown = [float(value) for value in re.findall(r'<td data-value="([^"]*)"', line)]
        flickers = [own["matched.flicker"].mean(), own["matched.flicker_linear"].mean()]
        expected = [7, own["matched.rmse"].mean(), own["matched.rmse"].max(), *flickers, own["wall_s"].sum() / 2]
        assert shown == pytest.approx(expected)
        assert "4 compared" in line
        assert f"frame {own.loc[own['matched.rmse'].idxmax(), 'frame']}" in line


def test_only_consecutive_frames_are_joined(folder: Path) -> None:
    rows = gather(*read(folder))["cornell-box"]
    drawn = {panel.id: panel for panel in panels(rows)}
    assert list(drawn) == ["rmse", "flicker", "seconds", "counter-rays"]
    assert [[frames for frames, _ in runs(line)] for line in drawn["rmse"].lines] == [[[0, 1, 2], [5]]] * 3
    assert [line.frames for line in drawn["flicker"].lines] == [(1, 2)] * 3
    assert [line.frames for line in drawn["seconds"].lines] == [tuple(range(7))] * 3
    first = series(rows[0], lambda result: float(result.seed))
    assert first.values == (0.5,) * 7


def test_everything_of_a_sequence_lies_beside_the_page(folder: Path) -> None:
    wanted = linked_files((folder / "index.html").read_text())
    assert [name for name in wanted if not (folder / name).is_file()] == []
    written = {str(path.relative_to(folder)) for path in (folder / "assets").rglob("*") if path.is_file()}
    assert written <= set(wanted)
    for name in (
        "assets/plots/s0-frames-flicker-dark.svg",
        "assets/sequence/s0-preview.webp",
        "assets/sequence/s0-r0-0-worst-error.png",
    ):
        assert name in written


def test_moving_pictures_keep_all_frames_in_step(folder: Path) -> None:
    with Image.open(folder / "assets" / "sequence" / "s0-preview.webp") as moving:
        assert getattr(moving, "n_frames", 1) == 7
        # three tiles of 16×12 pixels, enlarged by 20
        assert moving.size == (3 * 320, 240)
        assert moving.info["loop"] == 0
        moving.seek(1)
        moving.load()
        assert moving.info["duration"] == round(1000 / 24)


def test_a_reference_stands_beside_where_every_frame_has_one(tmp_path: Path) -> None:
    page = reports.write(make(tmp_path, methods=1, frames=3, size=SIZE)).read_text()
    assert "ir vpls=1024 · reference, one-bounce. Frames 0 to 2, at 24 frames a second." in page


def test_a_sequence_is_a_pure_function_of_the_folder(folder: Path, tmp_path: Path) -> None:
    again = make(tmp_path, methods=3, seeds=2, frames=7, size=SIZE, compared=COMPARED)
    reports.write(again)
    for path in sorted((folder / "assets").rglob("*")):
        assert path.is_dir() or path.read_bytes() == (again / path.relative_to(folder)).read_bytes(), path


def test_the_viewer_has_the_compared_and_the_worst_frames(folder: Path) -> None:
    rows = gather(*read(folder))["cornell-box"]
    assert [compared(row) for row in rows] == [sorted(COMPARED)] * 3
    assert chosen_frames(rows) == sorted(COMPARED)
    page = (folder / "index.html").read_text()
    found = re.search(r'id="s0-data">(.*?)</script>', page, re.S)
    assert found is not None
    assert [frame["frame"] for frame in json.loads(found[1])["frames"]] == sorted(COMPARED)
    worst_of = worst(rows[0])
    assert worst_of is not None
    assert worst_of[1] == max(result.metrics["matched"]["rmse"] or 0 for _, result in rows[0].done if result.metrics)


def test_one_compared_frame_has_no_flicker(tmp_path: Path) -> None:
    page = reports.write(make(tmp_path, methods=2, frames=3, size=SIZE, compared=frozenset({0}))).read_text()
    assert "1 compared" in page
    assert not (tmp_path / "assets" / "plots" / "s0-frames-flicker-light.svg").exists()
    table = pd.read_csv(tmp_path / "results.csv")
    assert "matched.flicker" not in table.columns or table["matched.flicker"].isna().all()


def test_missing_images_leave_the_plots(tmp_path: Path) -> None:
    folder = make(tmp_path, methods=2, frames=3, size=SIZE)
    for path in (folder / "images").iterdir():
        path.unlink()
    page = reports.write(folder).read_text()
    assert "Over the frames" in page
    assert "Moving pictures" not in page
    assert "Worst frames" not in page
    assert np.isfinite(pd.read_csv(folder / "results.csv")["matched.rmse"]).all()
