"""Real scenes: they load fast, keep their triangles, survive a round trip and are found by name."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from work import counted

from renderers import SceneError, builtin_scenes, load_scene
from renderers.scene.gltf import write_gltf

ROOT = Path(__file__).parents[2]


def scene_folder():
    folders = [Path(os.environ["LUXMETER_SCENES"])] if "LUXMETER_SCENES" in os.environ else []
    return next((f for f in [*folders, ROOT.parent / "shared" / "scenes"] if f.is_dir()), None)


NAMES = sorted(path.parent.name for path in scene_folder().glob("*/scene.glb")) if scene_folder() else []
real = pytest.mark.skipif(not NAMES, reason="folder of real scenes not present (LUXMETER_SCENES)")


@real
@pytest.mark.parametrize("name", NAMES or ["none"])
def test_real_scenes_load(name, tmp_path):
    folder = scene_folder() / name
    with counted() as work:
        scene = load_scene(folder / "scene.glb")
    facts = json.loads((folder / "scene.json").read_text())
    assert work.calls < 80_000  # by node, mesh, material and image, never by triangle: up to 55,000, in scenes of up to 235,271
    world = scene.world()
    dropped = sum(int(note.split()[0]) for note in scene.notes if note.endswith("triangles dropped"))
    if not any("removed" in note for note in scene.notes):
        assert len(world.triangles) <= facts["triangles"] <= len(world.triangles) + dropped + len(scene.nodes) * 10
    assert np.isfinite(world.face_normals).all()
    assert np.linalg.norm(world.normals, axis=1) == pytest.approx(np.ones(len(world.normals)), abs=1e-6)
    assert scene.cameras[0].yfov == pytest.approx(facts["camera"]["yfov_rad"])
    pose = world.camera.pose
    assert -pose[:3, 2] == pytest.approx(facts["camera"]["forward"], abs=1e-6)
    assert pose[:3, 3] / world.scale + world.centre == pytest.approx(facts["camera"]["position"], rel=1e-5, abs=1e-6 / world.scale)
    flux = sum(light["area"] for light in facts["lights"] if light["type"] == "area")
    # areas from float32 corners of meshes; the facts carry seven digits
    assert world.areas[world.emissive].sum() / world.scale**2 == pytest.approx(flux, rel=1e-4)
    assert ("animated_geometry" in scene.needs) == facts["features"]["animated"]
    write_gltf(scene, tmp_path / "copy.glb")
    assert load_scene(tmp_path / "copy.glb").hash == scene.hash


@real
def test_scenes_are_found_by_name(monkeypatch):
    monkeypatch.setenv("LUXMETER_SCENES", str(scene_folder()))
    assert load_scene(NAMES[0]).name == NAMES[0]


def test_names_come_from_the_scene_folder(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    original = load_scene("cornell-box")
    write_gltf(original, tmp_path / "mine" / "scene.glb")
    monkeypatch.setenv("LUXMETER_SCENES", str(tmp_path))
    assert load_scene("mine").hash == original.hash
    for name in ("../mine", "other", str(tmp_path)):
        with pytest.raises(SceneError, match="unknown scene"):
            load_scene(name)
    monkeypatch.delenv("LUXMETER_SCENES")
    with pytest.raises(SceneError, match=r"built-in: .*cornell-box"):
        load_scene("mine")


def test_every_built_in_scene_has_a_line():
    assert all(line.endswith((".", ";", ":")) or line for line in builtin_scenes().values())


def test_only_built_in_scenes_take_parameters(tmp_path):
    assert load_scene("cornell-box", light="point").parameters == {"light": "point"}
    write_gltf(load_scene("cornell-box"), tmp_path / "c.glb")
    with pytest.raises(SceneError, match="parameters"):
        load_scene(tmp_path / "c.glb", light="point")
