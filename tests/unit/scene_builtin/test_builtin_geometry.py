"""What every built-in scene promises: sound geometry, a camera that sees it, the same bytes in every process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from renderers import Scene, SceneError, builtin_scenes, load_scene
from renderers.scene.builtin import BUILTIN

ROOT = Path(__file__).parents[3]
NAMES = sorted(BUILTIN)
NEEDS = {
    "bouncing-spheres": {"diffuse", "glossy", "point_light", "animated_geometry"},
    "colonnade": {"diffuse", "directional_light"},
    "corner": {"diffuse", "directional_light"},
    "cornell-box": {"diffuse", "point_light"},
    "cornell-glossy": {"diffuse", "glossy", "point_light"},
    "cube-in-a-box": {"diffuse", "point_light", "animated_geometry"},
    "empty-room": {"diffuse", "point_light"},
    "furnace": {"diffuse", "area_light"},
    "gears": {"diffuse", "glossy", "area_light"},
    "interior": {"diffuse", "glossy", "point_light", "animated_geometry", "animated_light"},
    "kite": {"diffuse", "glossy", "point_light", "animated_geometry"},
    "leaves": {"diffuse", "area_light"},
    "moving-light": {"diffuse", "point_light", "animated_light"},
    "parallel-plates": {"diffuse", "directional_light"},
    "rectangle-light": {"diffuse", "area_light"},
    "sphere-in-sphere": {"diffuse", "area_light"},
    "thin-wall": {"diffuse", "point_light"},
}
VARIANTS = [
    ("cornell-box", {"light": "area"}), ("empty-room", {"light": "spot"}),
    ("furnace", {"shape": "box"}), ("furnace", {"shape": "sphere"}),
    ("sphere-in-sphere", {"source": "point"}), ("parallel-plates", {"light": "area"}), ("rectangle-light", {"occluder": 0.0}),
    ("corner", {"light": "area", "angle": 30.0}), ("thin-wall", {"thickness": 0.0}),
    ("colonnade", {"triangles": 20_000, "sky": True}),
    ("leaves", {"count": 100, "seed": 3}), ("gears", {"steps": 1, "turning": True}), ("gears", {"steps": 20}),
]  # fmt: skip
# single sheets show their backs: cloth, leaves, a kite, a wall without thickness; all other scenes show fronts only
SHEETS = [c for c in VARIANTS if c[0] in ("colonnade", "leaves", "thin-wall")] + [
    (name, {}) for name in ("colonnade", "leaves", "kite")
]
ALL = [(name, {}) for name in NAMES] + VARIANTS


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    return {str(case): load_scene(case[0], **case[1]) for case in ALL}


@pytest.mark.parametrize("case", ALL, ids=str)
def test_no_degenerate_triangle_no_nan_and_normals_agree_with_winding(scenes: dict[str, Scene], case: tuple[str, dict]) -> None:
    world = scenes[str(case)].world(0)
    assert np.isfinite(world.positions).all()
    assert world.areas.min() > 0
    np.testing.assert_allclose(np.linalg.norm(world.normals, axis=1), 1.0, atol=1e-5)
    cosine = np.einsum("tvi,ti->tv", world.normals[world.triangles], world.face_normals)
    # 0.3: at the coarsest tessellation a fold of cloth turns by up to 70° within one triangle; flipped ones would be negative
    assert cosine.min() > 0.3


@pytest.mark.parametrize("case", ALL, ids=str)
def test_camera_sees_geometry(scenes: dict[str, Scene], case: tuple[str, dict]) -> None:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    world = scenes[str(case)].world(0)
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(world.positions[world.triangles]))
    origins, directions = (np.ascontiguousarray(a.reshape(-1, 3), np.float32) for a in world.camera.rays((32, 18)))
    seen = scene.run(origins, directions)
    assert (seen >= 0).mean() > 0.08
    if case not in SHEETS:
        assert (np.einsum("pi,pi->p", world.face_normals[seen], directions)[seen >= 0] < 0).all()
    assert len(np.unique(world.instance[seen[seen >= 0]])) >= min(2, len(np.unique(world.instance)))


@pytest.mark.parametrize("name", NAMES)
def test_needs(scenes: dict[str, Scene], name: str) -> None:
    assert scenes[str((name, {}))].needs == NEEDS[name]


def test_needs_of_variants() -> None:
    assert load_scene("cornell-box", light="area").needs == {"diffuse", "area_light"}
    assert "environment" in load_scene("colonnade", triangles=20_000, sky=True).needs
    assert "animated_geometry" in load_scene("gears", steps=1, turning=True).needs


def test_same_bytes_in_another_process(scenes: dict[str, Scene]) -> None:
    code = "import renderers as r; print(*[r.load_scene(n).hash for n in sorted(r.builtin_scenes())])"
    other = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert other == [scenes[str((name, {}))].hash for name in NAMES]


def test_every_scene_has_a_describing_line_and_remembers_its_parameters() -> None:
    import inspect

    lines = builtin_scenes()
    assert set(lines) == set(NAMES)
    for name, builder in BUILTIN.items():
        assert len(lines[name]) > 40, name
        assert lines[name].endswith("."), name
        scene = load_scene(name)
        assert dict(scene.parameters) == {k: p.default for k, p in inspect.signature(builder).parameters.items()}
        assert scene.name == name


def test_seed_changes_the_scene_and_only_the_seeded_ones_have_it() -> None:
    assert load_scene("leaves", seed=1).hash != load_scene("leaves", seed=2).hash
    assert load_scene("bouncing-spheres", seed=1).hash != load_scene("bouncing-spheres", seed=2).hash


@pytest.mark.parametrize("triangles", [20_000, 60_000, 200_000, 2_000_000])
def test_colonnade_meets_its_triangle_count(triangles: int) -> None:
    assert len(load_scene("colonnade", triangles=triangles).world(0).triangles) == pytest.approx(triangles, rel=0.1)


def test_leaf_count_is_exact() -> None:
    scene = load_scene("leaves", count=1003)
    leaves = sum(len(scene.meshes[i].triangles) // 8 for n in scene.nodes for i in n.meshes if "spray" in n.name)
    assert leaves == 1003


def test_repeated_parts_are_instances() -> None:
    for name, most in (("colonnade", 40), ("gears", 30), ("leaves", 10), ("bouncing-spheres", 25), ("interior", 30)):
        scene = load_scene(name)
        placed = sum(len(n.meshes) for n in scene.nodes)
        assert len(scene.meshes) < most < placed


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("cornell-box", {"light": "sun"}, "cornell-box: light must be one of point, area; got 'sun'"),
        ("cornell-box", {"lihgt": "area"}, "cornell-box: unknown parameter 'lihgt'; there is light"),
        ("furnace", {"albedo": 1.5}, "furnace: albedo must lie in 0.0 .. 0.99; got 1.5"),
        ("furnace", {"albedo": float("nan")}, "furnace: albedo must be float; got nan"),
        ("colonnade", {"triangles": "many"}, "colonnade: triangles must be int; got 'many'"),
        ("colonnade", {"triangles": 20_000.5}, "colonnade: triangles must be int; got 20000.5"),
        ("colonnade", {"sky": "blue"}, "colonnade: sky must be bool; got 'blue'"),
        ("colonnade", {"sky": 1}, "colonnade: sky must be bool; got 1"),
        ("cornell-box", {"light": 3}, "cornell-box: light must be str; got 3"),
    ],
)  # fmt: skip
def test_bad_parameters_are_refused_in_one_line(name: str, parameters: dict, message: str) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(name, **parameters)
    assert str(refusal.value) == message


def test_parameters_may_come_as_text() -> None:
    assert load_scene("colonnade", triangles="20000", sky="true").hash == load_scene("colonnade", triangles=20_000, sky=True).hash
    assert load_scene("furnace", albedo="0.25").hash == load_scene("furnace", albedo=0.25).hash
