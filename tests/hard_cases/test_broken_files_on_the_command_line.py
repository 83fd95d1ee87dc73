"""Bad scene files through the real command: loadable ones render to finite images, the others end in one line and leave nothing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from work import FEW_CALLS, counted

from renderers import SceneError, load_scene
from renderers.images import read_exr
from renderers.scene.gltf.container import pack_glb

# What each file of the collection is answered with: a note of the result, or the reason of the refusal.
LOADABLE = {
    "00_good": "", "02_inf_and_zero_normals": "normal", "03_zero_area": "zero-area", "13_no_camera": "camera",
    "14_no_light": "light",
    "17_duplicate_faces": "duplicate", "18_flipped_normals": "winding", "19_non_indexed": "", "20_deep_nesting_5000": "",
}  # fmt: skip
REFUSED = (
    "01_nan_position", "04_index_out_of_range", "05_truncated", "06_truncated_header", "07_lying_total_length",
    "08_lying_chunk_length",
    "09_lying_accessor_count", "10_path_traversal_uri", "11_http_uri", "12_empty_scene", "15_scale_1e30", "16_scale_1e-30",
    "21_cyclic_nodes", "22_node_two_parents", "23_zero_fov", "24_unknown_required_extension", "25_not_a_glb", "26_json_nan",
)  # fmt: skip


def render(file: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = "from service.cli import main; main()"
    arguments = ["render", str(file), "--method", "ir", "--set", "vpls=64", "--size", "32x24", "--out", str(out), "--json"]
    return subprocess.run([sys.executable, "-c", command, *arguments], capture_output=True, text=True, check=False, timeout=120)


@pytest.fixture
def broken(scene_folder: Path) -> Path:
    return scene_folder / "broken"


@pytest.mark.parametrize("name", LOADABLE)
def test_loadable_files_render(name: str, broken: Path, tmp_path: Path) -> None:
    done = render(broken / f"{name}.glb", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    image = read_exr(tmp_path / "out" / "frame.exr")[0]["beauty"]
    assert np.isfinite(image).all()
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert LOADABLE[name] in " ".join(result["notes"])
    assert image.any() == (name != "14_no_light")


@pytest.mark.parametrize("name", REFUSED)
def test_the_others_are_refused_in_one_line(name: str, broken: Path, tmp_path: Path) -> None:
    done = render(broken / f"{name}.glb", tmp_path / "out")
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_bomb_of_nodes_and_primitives_is_refused_in_one_line(tmp_path: Path) -> None:
    """4 million drawn primitives in a file of 200 kB: their number is declared, and refused before any is read."""
    root = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(2000))}], "nodes": [{"mesh": 0}] * 2000,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * 2000}], "buffers": [{"byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
    }  # fmt: skip
    folder = tmp_path / "scenes"
    folder.mkdir()
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    (folder / "bomb.glb").write_bytes(pack_glb(root, corners.tobytes()))
    done = render(folder / "bomb.glb", tmp_path / "out")
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert "4000000 drawn primitives, more than the limit of 100000" in line
    assert not (tmp_path / "out").exists()
    with pytest.raises(SceneError), counted() as work:
        load_scene(folder / "bomb.glb")
    assert work.calls < FEW_CALLS + (folder / "bomb.glb").stat().st_size
