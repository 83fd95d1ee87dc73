"""`luxmeter render`, `reference`, `doctor`: what they write and print."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderers.images import read_exr
from service.cli import run

pytestmark = [pytest.mark.usefixtures("toy_methods"), pytest.mark.gl]


def test_one_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    arguments = ["render", "cornell-box:light=area", "--method", "flat", "--set", "level=2", "--size", "8x6", "--seed", "4"]
    assert run([*arguments, "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert sorted(p.name for p in out.iterdir()) == ["frame.exr", "frame.png", "result.json"]
    assert document == json.loads((out / "result.json").read_text())
    assert "metrics" not in document
    assert (document["scene"], document["seed"], document["width"], document["height"]) == ("cornell-box:light=area", 4, 8, 6)
    layers, _ = read_exr(out / "frame.exr")
    assert np.array_equal(layers[""], layers["beauty"])
    assert (layers["beauty"] == 2).all()
    with Image.open(out / "frame.png") as picture:
        assert np.asarray(picture).tolist() == [[[255] * 3] * 8] * 6  # exposure 1 / 99th percentile: a flat image is white


def test_a_range_of_frames_has_one_result_with_rows(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(["render", "cornell-box", "--method", "flat", "--size", "4x4", "--frames", "2:4", "--out", str(out)]) == 0
    names = [f"frame.{n:04d}.{suffix}" for n in (2, 3, 4) for suffix in ("exr", "png")]
    assert sorted(p.name for p in out.iterdir()) == sorted([*names, "result.json"])
    rows = json.loads((out / "result.json").read_text())["frames"]
    assert [row["frame"] for row in rows] == [2, 3, 4]
    assert [float(read_exr(out / f"frame.{n:04d}.exr")[0]["beauty"][0, 0, 0]) for n in (2, 3, 4)] == [1.5, 2.0, 2.5]


def test_diagnostic_pictures_are_layers_and_files_of_their_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(["render", "cornell-box", "--method", "tally", "--size", "4x4", "--frames", "5:6", "--out", str(out)]) == 0
    names = [f"frame.000{n}{suffix}" for n in (5, 6) for suffix in (".age-of-state.png", ".exr", ".png")]
    assert sorted(p.name for p in out.iterdir()) == [*names, "result.json"]
    layers, attributes = read_exr(out / "frame.0006.exr")
    assert (layers["debug.age-of-state"] == np.float32(2 / 8)).all()
    assert attributes["caption.debug.age-of-state"] == "white: eight frames or more"
    with Image.open(out / "frame.0006.age-of-state.png") as picture:
        # the sRGB curve of 0.25, whatever the exposure
        assert np.asarray(picture).tolist() == [[[137] * 3] * 4] * 4


def test_a_wanted_time_becomes_work_before_the_render(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(["render", "cornell-box", "--method", "budget", "--set", "seconds=0.7", "--size", "4x4", "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text())
    assert result["settings"] == {"subpixels": 1, "steps": 7, "seconds": None}
    assert sorted(p.name for p in out.iterdir()) == ["frame.exr", "frame.png", "result.json"]


def test_a_render_that_fails_exits_1_and_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "render",
        "cornell-box",
        "--method",
        "flat",
        "--set",
        "mode=raise",
        "--size",
        "4x4",
        "--out",
        str(tmp_path / "out"),
    ]
    assert run([*arguments, "--json"]) == 1
    captured = capsys.readouterr()
    assert captured.err.splitlines()[-1] == "luxmeter: ValueError: no such colour"
    assert json.loads(captured.out) == {"error": "ValueError: no such colour"}
    assert list(tmp_path.iterdir()) == []


@pytest.mark.mitsuba
def test_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    arguments = [
        "reference",
        "cornell-box",
        "--transport",
        "direct",
        "--size",
        "12x8",
        "--noise",
        "0.1",
        "--out",
        str(out),
        "--json",
    ]
    assert run(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert sorted(p.name for p in out.iterdir()) == ["reference.exr", "reference.json", "reference.png"]
    assert document == json.loads((out / "reference.json").read_text())
    layers, attributes = read_exr(out / "reference.exr")
    assert set(layers) == {"", "mean", "variance", "luminance_variance", "noise_sample"}
    assert layers["mean"].shape == (8, 12, 3)
    assert int(attributes["n"]) == document["replicates"] >= 16
    assert 0 < document["noise"] <= 0.1


def test_doctor_names_every_requirement(capsys: pytest.CaptureFixture[str]) -> None:
    code = run(["doctor", "--json"])
    document = json.loads(capsys.readouterr().out)
    assert code == (0 if document["ok"] else 1)
    names = [check["name"] for check in document["checks"]]
    assert names == ["Python", "OpenGL 4.3", "Mitsuba and LLVM", "Embree", "OpenEXR", "cores", "memory", "data folder", "Chromium"]
    assert all(check["ok"] or check["fix"] for check in document["checks"])


def test_doctor_fails_with_the_fix_where_the_data_folder_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "file"))
    assert run(["doctor", "--json"]) == 1
    folder = next(c for c in json.loads(capsys.readouterr().out)["checks"] if c["name"] == "data folder")
    assert not folder["ok"]
    assert "LUXMETER_HOME" in folder["fix"]
