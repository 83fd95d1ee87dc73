"""What glTF can say, feature by feature, from hand-made files."""

import base64
import io
import json

import numpy as np
import pytest
from gltf_maker import TRIANGLE, UP, Maker, simple
from PIL import Image

from renderers.scene.gltf import read_gltf
from renderers.scene.model import GGX, Lambert, PointLight, SceneError, SpotLight

PBR = "pbrMetallicRoughness"
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def png(pixels, mode=None):
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8), mode).save(file, "PNG")
    return file.getvalue()


def test_a_plain_file(tmp_path):
    scene = read_gltf(simple().save(tmp_path))
    assert scene.name == "made"
    assert scene.notes == ()
    assert scene.meshes[0].positions.tolist() == TRIANGLE.tolist()
    assert scene.meshes[0].triangles.tolist() == [[0, 1, 2]]
    assert scene.materials == (Lambert(albedo=(1, 1, 1), double_sided=False),)
    assert scene.lights == (PointLight(intensity=10),)
    assert scene.cameras[0].yfov == 0.8


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_indices_of_every_width(tmp_path, dtype):
    maker = Maker()
    maker.primitive(SQUARE, np.tile(UP[:1], (4, 1)), np.array([0, 1, 2, 0, 2, 3], dtype))
    assert read_gltf(maker.save(tmp_path)).meshes[0].triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(("mode", "triangles"), [(5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]])])
def test_strips_and_fans(tmp_path, mode, triangles):
    positions = SQUARE[[0, 1, 3, 2]] if mode == 5 else SQUARE
    maker = Maker()
    maker.primitive(positions, np.tile(UP[:1], (4, 1)), mode=mode)
    scene = read_gltf(maker.save(tmp_path))
    assert scene.meshes[0].triangles.tolist() == triangles
    assert scene.notes == ()  # nothing is wound against its normals
    assert scene.world().areas.sum() == pytest.approx(scene.world().scale ** 2)


def test_points_and_lines_are_noted(tmp_path):
    maker = simple()
    maker.root["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 1})
    assert "points and lines are ignored (1 primitives)" in read_gltf(maker.save(tmp_path)).notes


def test_interleaved_views(tmp_path):
    maker = Maker()
    view = maker.view(np.hstack([TRIANGLE, UP]).tobytes(), byteStride=24)
    item = {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"}
    maker.root["accessors"] += [item, item | {"byteOffset": 12}]
    maker.primitive(0, 1)
    mesh = read_gltf(maker.save(tmp_path)).meshes[0]
    assert mesh.positions.tolist() == TRIANGLE.tolist()
    assert mesh.normals.tolist() == UP.tolist()


@pytest.mark.parametrize(("dtype", "top"), [("i1", 127), ("i2", 32767), ("u1", 255), ("u2", 65535)])
def test_normalised_integers(tmp_path, dtype, top):
    maker = Maker()
    positions = maker.accessor((TRIANGLE * top).astype(dtype), normalized=True)
    maker.primitive(positions, maker.accessor((UP * top).astype(dtype), normalized=True))
    mesh = read_gltf(maker.save(tmp_path)).meshes[0]
    assert mesh.positions == pytest.approx(TRIANGLE)
    assert mesh.normals == pytest.approx(UP)


def test_sparse_accessors_patch_their_base(tmp_path):
    maker = Maker()
    part = maker.primitive()
    index = maker.accessor(np.array([1], "u2"))
    value = maker.accessor(np.array([[5, 0, 0]], "f4"))
    views = [maker.root["accessors"][k]["bufferView"] for k in (index, value)]
    sparse = {"count": 1, "indices": {"bufferView": views[0], "componentType": 5123}, "values": {"bufferView": views[1]}}
    maker.root["accessors"][part["attributes"]["POSITION"]]["sparse"] = sparse
    assert read_gltf(maker.save(tmp_path)).meshes[0].positions.tolist() == [[0, 0, 0], [5, 0, 0], [0, 1, 0]]


def test_missing_normals_are_flat(tmp_path):
    maker = Maker()
    tent = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    maker.primitive(tent, None, np.array([0, 1, 2, 0, 3, 1], "u1"))
    scene = read_gltf(maker.save(tmp_path))
    assert len(scene.meshes[0].positions) == 6
    assert scene.meshes[0].normals[[0, 3]].tolist() == [[0, 0, 1], [0, 1, 0]]
    assert scene.notes == ("normals missing: flat ones computed (2 triangles)",)


def test_instances_share_one_mesh(tmp_path):
    maker = simple()
    maker.root["nodes"].append({"mesh": 0, "translation": [5, 0, 0]})
    maker.root["meshes"].append(json.loads(json.dumps(maker.root["meshes"][0])))
    maker.root["nodes"].append({"mesh": 1, "translation": [9, 0, 0]})
    maker.root["scenes"][0]["nodes"] += [3, 4]
    scene = read_gltf(maker.save(tmp_path))
    assert len(scene.meshes) == 1
    assert [n.meshes for n in scene.nodes] == [(0,), (), (), (0,), (0,)]


def test_emission_and_units(tmp_path):
    maker = simple()
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 1366}}
    maker.root["materials"][0] |= {"emissiveFactor": [1, 0.5, 0], "extensions": strength}
    path = maker.save(tmp_path)
    scene, photometric = read_gltf(path), read_gltf(path, photometric=True)
    assert scene.materials[0].emission == (1366, 683, 0)
    assert photometric.materials[0].emission == pytest.approx((2, 1, 0))
    assert photometric.lights[0].intensity == pytest.approx(10 / 683)


def test_lights_cameras_and_what_they_lose(tmp_path):
    maker = simple()
    lights = maker.root["extensions"]["KHR_lights_punctual"]["lights"]
    lights.append(
        {"type": "spot", "intensity": 3, "color": [1, 0, 0], "range": 4, "spot": {"outerConeAngle": 0.6, "innerConeAngle": 0.1}}
    )
    maker.root["cameras"].insert(0, {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}})
    maker.root["nodes"][1]["camera"] = 1
    scene = read_gltf(maker.save(tmp_path))
    assert scene.lights[1] == SpotLight("", (1, 0, 0), 3, 0.1, 0.6)
    assert len(scene.cameras) == 1
    assert scene.nodes[1].camera == 0
    assert any("range of lights" in note for note in scene.notes)
    assert any("orthographic" in note for note in scene.notes)


def test_a_camera_is_framed_where_there_is_none(tmp_path):
    maker = simple()
    maker.root["scenes"][0]["nodes"] = [0, 2]
    scene = read_gltf(maker.save(tmp_path))
    assert "no camera: a view is framed from the bounding box" in scene.notes
    world = scene.world()
    seen = (world.positions - world.camera.pose[:3, 3]) @ world.camera.pose[:3, :3]
    assert (np.abs(seen[:, :2]) < -seen[:, 2:] * np.tan(world.camera.yfov / 2)).all()


def test_ggx_and_smooth_materials(tmp_path):
    maker = simple()
    maker.root["materials"] = [
        {PBR: {"baseColorFactor": [0.5, 0.4, 0.3, 1], "metallicFactor": 0, "roughnessFactor": 0}, "doubleSided": True}
    ]
    scene = read_gltf(maker.save(tmp_path))
    assert scene.materials == (GGX("", (0.5, 0.4, 0.3), 0, 0),)
    assert scene.notes == ("alpha of smooth materials is raised to 0.001 (1 materials)",)


def test_a_primitive_without_material_is_white_metal(tmp_path):
    maker = simple()
    del maker.root["meshes"][0]["primitives"][0]["material"]
    scene = read_gltf(maker.save(tmp_path))
    assert scene.meshes[0].material == 1
    assert scene.materials[1] == GGX("default", double_sided=False)


@pytest.mark.parametrize(
    ("mode", "alpha", "cutoff", "kept"),
    [("MASK", 0.4, 0.5, 0), ("MASK", 0.4, 0.3, 1), ("BLEND", 0.49, 0.5, 0), ("BLEND", 0.5, 0.5, 1), ("OPAQUE", 0.0, 0.5, 1)],
)
def test_alpha_removes_or_is_opaque(tmp_path, mode, alpha, cutoff, kept):
    maker = simple()
    maker.root["materials"] = [
        {"alphaMode": mode, "alphaCutoff": cutoff, PBR: {"baseColorFactor": [1, 1, 1, alpha], "metallicFactor": 0}}
    ]
    if mode != "MASK":
        del maker.root["materials"][0]["alphaCutoff"]
    scene = read_gltf(maker.save(tmp_path))
    assert len(scene.meshes) == kept
    assert any(mode in note for note in scene.notes) == (mode != "OPAQUE")


def textured(maker, image, **info):
    maker.root["images"] = [image]
    maker.root["textures"] = [{"source": 0, "sampler": 0}]
    maker.root["samplers"] = [{"wrapS": 33071, "wrapT": 33648}]
    maker.root["materials"][0][PBR]["baseColorTexture"] = {"index": 0, **info}
    maker.root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = maker.accessor(TRIANGLE[:, :2].copy())


def test_textures_from_views_and_data_uris(tmp_path):
    pixels = np.arange(18).reshape(2, 3, 3)
    maker = simple()
    textured(maker, {"bufferView": maker.view(png(pixels)), "mimeType": "image/png"})
    inside = read_gltf(maker.save(tmp_path))
    maker.root["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(png(pixels)).decode()}]
    by_uri = read_gltf(maker.save(tmp_path))
    for scene in (inside, by_uri):
        assert scene.textures[0].pixels.tolist() == pixels.tolist()
        assert scene.textures[0].wrap == ("clamp", "mirror")
        assert scene.materials[0].texture == 0
        assert scene.meshes[0].uvs.tolist() == TRIANGLE[:, :2].tolist()


def test_texture_transforms_are_applied(tmp_path):
    maker = simple()
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": np.pi / 2, "scale": [2, 3]}}
    textured(maker, {"bufferView": maker.view(png(np.zeros((1, 1, 3))))}, extensions=transform)
    uvs = read_gltf(maker.save(tmp_path)).meshes[0].uvs
    # the extension's matrices: translation · rotation · scale, rotation by -angle in (u, v): (u, v) -> (c u + s v, -s u + c v)
    assert uvs == pytest.approx(np.array([[0.1, 0.2], [0.1, 0.2 - 2], [0.1 + 3, 0.2]]), abs=1e-6)


def test_all_that_is_lost_is_noted(tmp_path):
    maker = simple()
    part = maker.root["meshes"][0]["primitives"][0]
    part["attributes"]["COLOR_0"] = part["attributes"]["NORMAL"]
    part["targets"] = [{}]
    maker.root["materials"][0] |= {
        "normalTexture": {"index": 0},
        "occlusionTexture": {"index": 0},
        "emissiveTexture": {"index": 0},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}},
    }
    maker.root["images"], maker.root["textures"] = [{"bufferView": 0}], [{"source": 0}]
    maker.root["nodes"][0]["skin"] = 0
    maker.root["nodes"].append({"name": "elsewhere"})
    maker.root["scenes"].append({"nodes": [3]})
    maker.root["asset"]["copyright"] = "CC0"
    maker.root["meshes"][0]["extras"] = {"a": 1}
    scene = read_gltf(maker.save(tmp_path))
    text = "\n".join(scene.notes)
    for word in ("COLOR_0", "morph", "normalTexture", "occlusionTexture", "emissiveTexture", "KHR_materials_transmission", "skins",
                 "outside the active scene", "scenes other than", "extras of elements"):  # fmt: skip
        assert word in text
    assert len(scene.notes) == 10
    assert scene.textures == ()
    assert scene.parameters == {"copyright": "CC0"}


def animated(maker, target, values, mode="LINEAR", times=(0.0, 1.0)):
    sampler = {"input": maker.accessor(np.array(times, "f4")), "output": maker.accessor(values), "interpolation": mode}
    animation = maker.root.setdefault("animations", [{"samplers": [], "channels": []}])[0]
    animation["samplers"].append(sampler)
    animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})


def pointer(text):
    return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": text}}}


def test_animation_of_nodes_lights_and_cameras(tmp_path):
    maker = simple()
    animated(maker, {"node": 0, "path": "translation"}, np.array([[0, 0, 0], [2, 0, 0]], "f4"))
    animated(maker, pointer("/extensions/KHR_lights_punctual/lights/0/intensity"), np.array([10, 20], "f4"), "STEP")
    animated(maker, pointer("/extensions/KHR_lights_punctual/lights/0/color"), np.array([[0, 0, 0], [255, 255, 255]], "u1"))
    animated(maker, pointer("/cameras/0/perspective/yfov"), np.array([0, 0.5, 0, 0, 1, 0], "f4"), "CUBICSPLINE")
    maker.root["accessors"][-3]["normalized"] = True
    animated(maker, {"node": 0, "path": "weights"}, np.array([0, 1], "f4"))
    animated(maker, pointer("/materials/0/emissiveFactor"), np.array([[0, 0, 0], [1, 1, 1]], "f4"))
    animated(maker, {"node": 0, "path": "translation"}, np.array([[0, 0, 0], [9, 0, 0]], "f4"))
    scene = read_gltf(maker.save(tmp_path))
    assert [(c.target, c.path, c.interpolation) for c in scene.channels] == [
        ("node", "translation", "LINEAR"),
        ("light", "intensity", "STEP"),
        ("light", "color", "LINEAR"),
        ("camera", "yfov", "CUBICSPLINE"),
    ]
    half = scene.at(12)
    assert half.nodes[0].translation == (1, 0, 0)
    assert half.lights[0].intensity == 10
    assert half.lights[0].color == (0.5, 0.5, 0.5)
    assert half.cameras[0].yfov == 0.75
    assert len(scene.notes) == 3


def test_rotations_may_be_normalised_shorts(tmp_path):
    maker = simple()
    maker.root["nodes"][0]["rotation"] = [0, 0, 0, 1]
    animated(maker, {"node": 0, "path": "rotation"}, np.array([[0, 0, 0, 32767], [0, 0, 32767, 0]], "i2"))
    maker.root["accessors"][-1]["normalized"] = True
    scene = read_gltf(maker.save(tmp_path))
    assert scene.at(12).nodes[0].rotation == pytest.approx((0, 0, np.sqrt(0.5), np.sqrt(0.5)))


def test_text_gltf_finds_its_buffer_beside_it_and_nowhere_else(tmp_path):
    maker = simple()
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "data.bin").write_bytes(maker.binary)
    (tmp_path / "secret.bin").write_bytes(maker.binary)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")

    def written(uri):
        path = folder / "scene.gltf"
        path.write_text(json.dumps(maker.root | {"buffers": [{"byteLength": len(maker.binary), "uri": uri}]}))
        return path

    scene = read_gltf(written("data.bin"))
    assert scene.name == "scene"
    assert len(scene.meshes) == 1
    assert len(read_gltf(written("data:;base64," + base64.b64encode(maker.binary).decode())).meshes) == 1
    for uri in (
        "../secret.bin",
        "%2e%2e/secret.bin",
        str(tmp_path / "secret.bin"),
        "file:///etc/passwd",
        "http://x/y",
        "link.bin",
        "",
        ".",
    ):
        with pytest.raises(SceneError, match="external URI"):
            read_gltf(written(uri))


def test_matrices_and_children(tmp_path):
    maker = simple()
    maker.root["nodes"][1] |= {"children": [0]}
    maker.root["scenes"][0]["nodes"] = [1, 2]
    maker.root["nodes"][0]["matrix"] = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 1, 0, 0, 1]
    scene = read_gltf(maker.save(tmp_path))
    assert scene.nodes[0].parent == 1
    world = scene.world()
    metres = world.positions / world.scale + world.centre
    assert metres == pytest.approx(TRIANGLE * 2 + (1, 0, 3), abs=1e-6)
