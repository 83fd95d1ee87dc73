"""OBJ and PLY: groups, materials, what is added, what is refused and on which line."""

import numpy as np
import pytest

from renderers import SceneError, load_scene
from renderers.scene.model import Lambert, PointLight

OBJ = """mtllib m.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
vn 0 0 1
usemtl red
f 1//1 2//1 3//1 4//1
usemtl lamp
f -5 -4 -1
f 2 3 5
"""
PLY = """ply
format ascii 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
1 1 {z}
0 1 0
4 0 1 2 {last}
"""


def ply(tmp_path, vertices=4, faces=1, z="0", last="3", name="p.ply"):
    path = tmp_path / name
    path.write_text(PLY.format(vertices=vertices, faces=faces, z=z, last=last))
    return path


def test_obj_materials_become_meshes(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 0.63 0.06 0.05\nKs 1 1 1\nmap_Kd ../x.png\nnewmtl lamp\nKd 0 0 0\nKe 5 4 3\n")
    scene = load_scene(tmp_path / "a.obj")
    assert scene.materials == (
        Lambert("red", (0.63, 0.06, 0.05)),
        Lambert("lamp", (0, 0, 0), emission=(5, 4, 3), double_sided=False),
    )
    assert [(m.name, len(m.triangles), len(m.positions)) for m in scene.meshes] == [("red", 2, 4), ("lamp", 2, 6)]
    assert scene.meshes[0].normals.tolist() == [[0, 0, 1]] * 4
    assert scene.needs == {"diffuse", "area_light"}
    assert scene.lights == ()
    assert set(scene.notes) == {
        "Ks of OBJ materials is ignored (1 materials)",
        "map_Kd of OBJ materials is ignored (1 materials)",
        "normals missing: flat ones computed (2 triangles)",
        "no camera: a view is framed from the bounding box",
    }


def test_obj_without_library_is_grey_and_lit_by_a_headlight(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    scene = load_scene(tmp_path / "a.obj")
    assert {m.albedo for m in scene.materials} == {(0.8, 0.8, 0.8)}
    assert isinstance(scene.lights[0], PointLight)
    assert "no light: a point light is added above the camera" in scene.notes
    world = scene.world()
    seen = (world.positions - world.camera.pose[:3, 3]) @ world.camera.pose[:3, :3]
    assert (np.abs(seen[:, :2]) < -seen[:, 2:] * np.tan(world.camera.yfov / 2)).all()


@pytest.mark.parametrize(
    ("old", "new", "line", "reason"),
    [
        ("v 1 1 0", "v 1 nan 0", 4, "finite"),
        ("v 1 1 0", "v 1 1e39 0", 4, "finite"),
        ("v 1 1 0", "v 1 1", 4, "three"),
        ("vn 0 0 1", "vn nan nan nan", 7, "finite"),
        ("f 2 3 5", "f 2 3 99", 12, "99 names none of the 5"),
        ("f 2 3 5", "f 2 3 0", 12, "names none"),
        ("f 2 3 5", "f 2 3", 12, "three corners"),
        ("f 2 3 5", "f 2 3 x", 12, "no integer"),
    ],
)
def test_obj_faults_are_named_by_line(tmp_path, old, new, line, reason):
    (tmp_path / "a.obj").write_text(OBJ.replace(old, new))
    with pytest.raises(SceneError, match=rf"a\.obj: line {line}: .*{reason}"):
        load_scene(tmp_path / "a.obj")


def test_obj_library_outside_the_folder_is_not_opened(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (folder / "a.obj").write_text(OBJ.replace("m.mtl", "../m.mtl"))
    scene = load_scene(folder / "a.obj")
    assert any("../m.mtl" in note for note in scene.notes)
    assert scene.materials[0].albedo == (0.8, 0.8, 0.8)


def test_ply_quads(tmp_path):
    scene = load_scene(ply(tmp_path))
    assert len(scene.meshes[0].triangles) == 2
    assert scene.needs == {"diffuse", "point_light"}
    assert scene.world().areas.sum() / scene.world().scale ** 2 == pytest.approx(1)


def test_binary_ply_with_normals(tmp_path):
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=1)
    (tmp_path / "ball.ply").write_bytes(ball.export(file_type="ply", vertex_normal=True))
    mesh = load_scene(tmp_path / "ball.ply").meshes[0]
    assert (len(mesh.positions), len(mesh.triangles)) == (42, 80)
    # vertices of a unit icosphere are their own normals, area-weighted ones lie within a few degrees
    assert (np.sum(mesh.normals * mesh.positions, axis=1) > 0.99).all()


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ({"z": "nan"}, "vertex 2: position is not finite"),
        ({"last": "9"}, "names none of the 4 vertices"),
        ({"vertices": 100_000_000}, "don't fit"),
        ({"vertices": 6}, "file:"),
        ({"faces": 3}, "header says"),
    ],
)
def test_ply_faults(tmp_path, fault, reason):
    with pytest.raises(SceneError, match=reason):
        load_scene(ply(tmp_path, **fault))


@pytest.mark.parametrize("name", ["x.ply", "x.obj"])
def test_nonsense(tmp_path, name):
    (tmp_path / name).write_bytes(b"PK\x03\x04" + bytes(range(256)))
    if name == "x.ply":
        with pytest.raises(SceneError, match="not a PLY"):
            load_scene(tmp_path / name)
    else:
        scene = load_scene(tmp_path / name)
        assert "scene has no geometry" in scene.notes
        with pytest.raises(SceneError, match="no geometry"):
            scene.world()
