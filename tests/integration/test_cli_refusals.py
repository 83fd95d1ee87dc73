"""Bad input: exit code 2, one line on stderr, no traceback, nothing written, and no graphics library loaded on the way."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from jobs.process import child_environment

pytestmark = pytest.mark.usefixtures("toy_methods")

HEAVY = ("pyrender", "moderngl", "numba", "mitsuba", "embreex", "OpenEXR", "matplotlib", "pandas", "skimage", "trimesh")
PROGRAM = f"""
import sys
from service.cli import run
code = run(sys.argv[1:])
print("HEAVY", sorted(set({HEAVY}) & set(sys.modules)), file=sys.stderr)
sys.exit(code)
"""
OUT = ["--out", "out"]
BOX = ["cornell-box", "--method", "flat", *OUT]
EVALUATE = ["evaluate", "--scene", "cornell-box", "--method", "flat", *OUT]


def luxmeter(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, *arguments]
    return subprocess.run(command, cwd=folder, env=child_environment(), capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["paint"], "No such command 'paint'"),
        (["render", "cornell-box", *OUT], "Missing option '--method'"),
        (["render", "nosuch", "--method", "flat", *OUT], "unknown scene 'nosuch'"),
        (["render", "missing.glb", "--method", "flat", *OUT], "missing.glb"),
        (["render", "cornell-box:lamp=1", "--method", "flat", *OUT], "cornell-box has no parameter 'lamp'"),
        (["render", "cornell-box", "--method", "nosuch", *OUT], "unknown method 'nosuch'"),
        (["render", *BOX, "--set", "level=11"], "flat.level must be number ≥ 0, ≤ 10 (got '11')"),
        (["render", *BOX, "--set", "level=nan"], "flat.level must be"),
        (["render", *BOX, "--set", "hue=1"], "flat has no setting 'hue'"),
        (["render", *BOX, "--size", "huge"], "--size takes WIDTHxHEIGHT"),
        (["render", *BOX, "--frames", "5:1"], "--frames takes A:B"),
        (["render", *BOX, "--seed", "-1"], "--seed"),
        (["reference", "cornell-box", "--transport", "sideways", *OUT], "--transport takes one of direct, one-bounce"),
        (["reference", "cornell-box", "--noise", "0", *OUT], "--noise takes a number above 0"),
        ([*EVALUATE, "--sweep", "flat.level=1,99"], "flat.level must be number ≥ 0, ≤ 10 (got '99')"),
        ([*EVALUATE, "--noise", "2"], "noise: input should be less than or equal to 1 (got 2.0)"),
        ([*EVALUATE, "--seeds", "0"], "seeds: input should be greater than or equal to 1 (got 0)"),
        (["methods", "nosuch"], "unknown method 'nosuch'; known: "),
    ],
)
def test_one_line_and_nothing_else(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = luxmeter([*arguments, "--json"], tmp_path)
    line, heavy = done.stderr.splitlines()
    assert done.returncode == 2
    assert line.startswith("luxmeter: ")
    assert message in line
    assert heavy == "HEAVY []"
    assert json.loads(done.stdout) == {"error": line.removeprefix("luxmeter: ")}
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_the_user_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("years")
    for extra in ([], ["--force"]):
        done = luxmeter(["render", *BOX, *extra], tmp_path)
        assert done.returncode == 2
        assert "out" in done.stderr
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("command", [["scenes"], ["methods"], ["methods", "flat"]])
def test_lists_load_no_graphics_library(command: list[str], tmp_path: Path) -> None:
    done = luxmeter([*command, "--json"], tmp_path)
    assert done.returncode == 0
    assert done.stderr == "HEAVY []\n"
    document = json.loads(done.stdout)
    assert "cornell-box" in str(document) if command == ["scenes"] else "flat" in str(document)
