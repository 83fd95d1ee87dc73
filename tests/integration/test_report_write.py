"""A whole report from a synthetic evaluation folder."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from report_evaluation import METHODS, make

import reports
from renderers.images import read_exr
from reports.folder import read


def digest(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.rglob("*")) if p.is_file()
    }


class Links(HTMLParser):
    """Collects what a page refers to, and checks that its tags close."""

    VOID = frozenset({"meta", "link", "input", "img", "source", "rect", "line", "br"})

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.ids: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("href", "src", "srcset") and value:
                self.targets.append(value)
            if name == "id" and value:
                self.ids.append(value)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make(
        tmp_path_factory.mktemp("evaluation"),
        scenes=3,
        methods=6,
        seeds=2,
        failing=frozenset({(0, 0), *((1, m) for m in range(6))}),
    )
    reports.write(made)
    return made


def parsed(folder: Path) -> Links:
    links = Links()
    links.feed((folder / "index.html").read_text())
    return links


def test_report_is_a_pure_function_of_the_folder(folder: Path, tmp_path: Path) -> None:
    again = make(tmp_path, scenes=3, methods=6, seeds=2, failing=frozenset({(0, 0), *((1, m) for m in range(6))}))
    (again / "assets").mkdir()
    (again / "assets" / "stale.js").write_text("left by an older report")
    reports.write(again)
    first = digest(again)
    reports.write(again)
    assert digest(again) == first == digest(folder)


def test_everything_the_page_needs_lies_beside_it(folder: Path) -> None:
    links = parsed(folder)
    assert links.open == []
    assert len(set(links.ids)) == len(links.ids)
    for target in links.targets:
        assert not target.startswith(("http", "//")), target
        if target.startswith("#"):
            assert target[1:] in links.ids
        elif not target.startswith("data:"):
            assert (folder / target).is_file(), target
    for name in ("report.css", "report.js", "viewer.js"):
        assert "http" not in (folder / "assets" / name).read_text()


def test_page_names_scenes_methods_failures_and_best(folder: Path) -> None:
    page = (folder / "index.html").read_text()
    for label in [m[1] for m in METHODS[:6]]:
        assert label in page
    assert "All cells failed." in page
    assert "needs &lt;environment&gt;" in page
    assert "<environment>" not in page
    assert page.count('class="best"') > 6
    assert "Aliasing (box − centre" in page


def test_tables_agree_with_the_results(folder: Path) -> None:
    _, results = read(folder)
    parquet, csv = pd.read_parquet(folder / "results.parquet"), pd.read_csv(folder / "results.csv")
    assert len(parquet) == len(csv) == 36
    assert set(parquet["state"]) == {"done", "failed"}
    for line in parquet[parquet["state"] == "done"].itertuples():
        result = results[line.id]
        assert parquet.loc[line.Index, "matched.rmse"] == result.metrics["matched"]["rmse"]
        assert parquet.loc[line.Index, "counters.rays"] == result.counters["rays"]
        assert parquet.loc[line.Index, "wall_s"] == result.seconds
        assert json.loads(line.settings) == result.settings
    assert csv["full.ssim"].to_numpy() == pytest.approx(parquet["full.ssim"].to_numpy(float), nan_ok=True)


def test_viewer_data_are_the_floats_of_the_exr(folder: Path) -> None:
    evaluation, _ = read(folder)
    page = (folder / "index.html").read_text()
    data = json.loads(re.search(r'<script type="application/json" id="s0-data">(.*?)</script>', page, re.S)[1])
    assert data["exposure"] == evaluation.scenes[0].exposure
    image = next(i for i in data["frames"][0]["images"] if i["label"] == "flc")
    assert {image["matched"], image["full"]} <= {i["id"] for i in data["frames"][0]["images"]}
    script = (folder / "assets" / "data" / f"{image['id']}.js").read_text()
    stored = json.loads(script.removeprefix(f'luxmeter.image("{image["id"]}",').removesuffix(");\n"))
    pixels = np.frombuffer(base64.b64decode(stored["rgb"]), "<f4").reshape(stored["height"], stored["width"], 3)
    cell = next(c for c in evaluation.cells if c.label == "flc" and c.seed == 0 and c.scene == "cornell-box")
    assert np.array_equal(pixels, read_exr(folder / "images" / f"{cell.id}.exr")[0]["beauty"])
    states = np.frombuffer(base64.b64decode(stored["over"][image["matched"]]), np.uint8)
    assert states.size == stored["width"] * stored["height"]
    assert set(states) <= {0, 1, 2}


def test_one_scene_and_one_method(tmp_path: Path) -> None:
    page = reports.write(make(tmp_path)).read_text()
    assert "nothing else was measured" in page
    assert "one seed" in page
    assert "<nav" not in page


def test_sequence_shows_flicker_and_frames(tmp_path: Path) -> None:
    page = reports.write(make(tmp_path, methods=2, frames=3)).read_text()
    assert "Flicker" in page
    assert json.loads(re.search(r'id="s0-data">(.*?)</script>', page, re.S)[1])["frames"][2]["frame"] == 2


def test_missing_images_and_references_leave_a_report(tmp_path: Path) -> None:
    folder = make(tmp_path, methods=2, seeds=2)
    for path in [*(folder / "images").iterdir(), *(folder / "references").iterdir()]:
        path.unlink()
    page = reports.write(folder).read_text()
    assert "Error and time" in page
    assert "Where the error comes from" not in page
    assert 'class="viewer"' not in page


def test_results_without_a_comparison(tmp_path: Path) -> None:
    folder = make(tmp_path, methods=2)
    for path in (folder / "results").iterdir():
        result = json.loads(path.read_text()) | {"metrics": {}, "noise_floor": {}}
        path.write_text(json.dumps(result))
    assert "Nothing was compared with a reference." in reports.write(folder).read_text()


def test_nothing_finished_yet(tmp_path: Path) -> None:
    folder = make(tmp_path, methods=2)
    for path in (folder / "results").iterdir():
        path.unlink()
    document = json.loads((folder / "evaluation.json").read_text())
    document["cells"] = [c | {"state": "cancelled"} for c in document["cells"]]
    (folder / "evaluation.json").write_text(json.dumps(document))
    page = reports.write(folder).read_text()
    assert "Not rendered" in page
    assert "cancelled" in page


def test_labels_are_escaped(tmp_path: Path) -> None:
    folder = make(tmp_path)
    for path in [folder / "evaluation.json", *(folder / "results").iterdir()]:
        path.write_text(path.read_text().replace("ir vpls=1024", "<script>alert(1)</script>"))
    assert "<script>alert" not in reports.write(folder).read_text()


def test_folder_without_an_evaluation(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        reports.write(tmp_path)
