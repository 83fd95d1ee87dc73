"""Faulty scene files: each is answered by one line that names file, element and reason, for little work, or loads with a note.

The faults are built here from a good file; the folder `broken/` of the shared scenes has more of them, checked where it is present.
"""

import json
import os
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from work import FEW_CALLS, counted

from renderers import SceneError, load_scene
from renderers.scene.builder import SceneBuilder
from renderers.scene.gltf.container import pack_glb, split_glb
from renderers.scene.gltf.write import gltf_bytes
from renderers.scene.model import Lambert, PointLight

ROOT = Path(__file__).parents[2]
MEGABYTE = 2**20


def good_bytes():
    b = SceneBuilder("good")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert("grey")), "floor")
    b.light(PointLight("lamp", intensity=10.0), (0, 2, 0))
    b.camera((0, 1, 4), (0, 0, 0), 0.8)
    return gltf_bytes(b.build())


GOOD = good_bytes()


def parts():
    """JSON and binary chunk of the good file, free to be spoiled."""
    text, chunk = split_glb(GOOD, "good")
    return json.loads(bytes(text)), bytearray(chunk)


def refusal(path):
    """The one line that answers `path`, after checking that it is one line, cheap, and light on memory."""
    with pytest.raises(SceneError), counted() as work:
        load_scene(path).world()
    assert work.calls <= FEW_CALLS + path.stat().st_size
    # Memory only afterwards, because tracing is slow.
    tracemalloc.start()
    try:
        with pytest.raises(SceneError) as caught:
            load_scene(path).world()
        assert tracemalloc.get_traced_memory()[1] < 100 * MEGABYTE
    finally:
        tracemalloc.stop()
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def test_the_good_file_is_good(tmp_path):
    (tmp_path / "good.glb").write_bytes(GOOD)
    scene = load_scene(tmp_path / "good.glb")
    assert scene.notes == ()
    assert len(scene.world().triangles) == 2


@pytest.mark.parametrize("length", sorted({0, 3, 9, 12, 16, 20, 40, len(GOOD) // 2, len(GOOD) - 70, len(GOOD) - 1}))
def test_truncation(tmp_path, length):
    (tmp_path / "cut.glb").write_bytes(GOOD[:length])
    assert any(word in refusal(tmp_path / "cut.glb") for word in ("not a GLB", "bytes, the file has"))


@pytest.mark.parametrize(("at", "reason"), [(8, "the file has"), (12, "are left")])
def test_lying_lengths(tmp_path, at, reason):
    data = bytearray(GOOD)
    struct.pack_into("<I", data, at, 0xFFFFFFF0)
    (tmp_path / "lie.glb").write_bytes(data)
    assert reason in refusal(tmp_path / "lie.glb")


def spoil_cycle(root, _):
    root["nodes"][0]["children"], root["nodes"][1]["children"] = [1], [0]


def spoil_self(root, _):
    root["nodes"][0]["children"] = [0]


def spoil_parents(root, _):
    root["nodes"][1]["children"] = [0]


def spoil_index(root, binary):
    item = root["accessors"][root["meshes"][0]["primitives"][0]["indices"]]
    struct.pack_into("<H", binary, root["bufferViews"][item["bufferView"]]["byteOffset"] + 4, 60000)


def spoil_position(root, binary):
    struct.pack_into("<f", binary, 4 * (3 * 2 + 1), np.nan)


def spoil_count(root, _):
    root["accessors"][0]["count"] = 100_000_000


def spoil_zeros(root, _):
    del root["accessors"][0]["bufferView"]
    root["accessors"][0]["count"] = 10**9


def spoil_fov(root, _):
    root["cameras"][0]["perspective"]["yfov"] = 0


def spoil_scale(root, _):
    root["nodes"][0]["scale"] = [1e30, 1e30, 1e30]


def spoil_overflow(root, _):
    root["nodes"][0]["scale"] = [1e200, 1e200, 1e200]
    root["nodes"].append({"scale": [1e200, 1e200, 1e200], "children": [0]})
    root["scenes"][0]["nodes"] = [1, 2, 3]


def spoil_extension(root, _):
    root["extensionsRequired"] = ["KHR_draco_mesh_compression"]


def spoil_version(root, _):
    root["asset"]["version"] = "1.0"


def spoil_light(root, _):
    root["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = -1


def spoil_albedo(root, _):
    root["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [-0.5, 0, 0, 1]


def spoil_image(root, _):
    root["images"] = [{"bufferView": 0}]
    root["textures"] = [{"source": 0}]


def spoil_uri(root, _):
    root["images"] = [{"uri": "../../etc/passwd"}]


def spoil_name(root, _):
    root["materials"][0]["name"] = "two\nlines \ud800" * 9
    root["materials"][0]["alphaMode"] = "GLASS"


def spoil_types(root, _):
    root["nodes"] = {"0": 1}


def spoil_matrix(root, _):
    root["nodes"][0]["matrix"] = [0] * 16


def spoil_instances(root, _):
    root["nodes"] += [{"mesh": 0}] * 100_001


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_cycle, "cycle"),
        (spoil_self, "cycle"),
        (spoil_parents, "two parents"),
        (spoil_index, "index 60000 at 2 names none of the"),
        (spoil_position, "'floor' primitives[0]: vertex 2: POSITION is not finite"),
        (spoil_count, "100000000 elements need"),
        (spoil_zeros, "over the limit"),
        (spoil_fov, "yfov must lie in (0, 3.14159)"),
        (spoil_scale, "half diagonal 1.41e+30 m"),
        (spoil_overflow, "half diagonal inf m"),
        (spoil_extension, "KHR_draco_mesh_compression"),
        (spoil_version, "version '1.0'"),
        (spoil_light, "'lamp': intensity must lie in [0, 1e+30]"),
        (spoil_albedo, "baseColorFactor must lie in [0, 1]"),
        (spoil_image, "not a readable PNG or JPEG"),
        (spoil_uri, "external URI '../../etc/passwd'"),
        (spoil_name, "alphaMode must be one of"),
        (spoil_types, "nodes must be an array"),
        (spoil_matrix, "affine"),
        (spoil_instances, "100004 nodes, more than the limit"),
    ],
)
def test_faults_are_named(tmp_path, spoil, words):
    root, binary = parts()
    spoil(root, binary)
    (tmp_path / "bad.glb").write_bytes(pack_glb(root, bytes(binary)))
    assert words in refusal(tmp_path / "bad.glb")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b'{"asset": {"version": "2.0"}, "a": NaN}', "NaN is not JSON"),
        (b'{"asset": {"version": "2.0"}, "a": -Infinity}', "-Infinity is not JSON"),
        (b'{"asset": {"version": "2.0"}, "cameras": [{"type": "perspective", "perspective": {"yfov": 1e999}}]}', "finite"),
        (b'{"asset": {"version": "2.0"}, "a": 1' + b"0" * 5000 + b"}", "JSON"),
        (b"[" * 100_000, "JSON"),
        (b"[]", "must be an object"),
        (b'{"asset": ', "JSON"),
        (b"\xff\xfe{}", "JSON"),
    ],
)
def test_bad_json(tmp_path, text, words):
    (tmp_path / "bad.gltf").write_bytes(text)
    assert words in refusal(tmp_path / "bad.gltf")


def test_a_huge_image_is_refused_by_its_header(tmp_path):
    import zlib

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    root, binary = parts()
    root["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(bomb)})
    root["buffers"][0]["byteLength"] = len(binary) + len(bomb)
    root["images"] = [{"bufferView": len(root["bufferViews"]) - 1}]
    root["textures"] = [{"source": 0}]
    (tmp_path / "bomb.glb").write_bytes(pack_glb(root, bytes(binary) + bomb))
    assert "images[0]" in refusal(tmp_path / "bomb.glb")


def test_few_meshes_drawn_by_many_nodes_are_counted_before_they_are_read(tmp_path):
    root, binary = parts()
    drawn = next(node["mesh"] for node in root["nodes"] if "mesh" in node)
    primitive = root["meshes"][drawn]["primitives"][0]
    root["meshes"].append({"primitives": [primitive] * 2000})
    root["nodes"] += [{"mesh": len(root["meshes"]) - 1} for _ in range(2000)]
    path = tmp_path / "bomb.glb"
    path.write_bytes(pack_glb(root, bytes(binary)))
    assert "drawn primitives, more than the limit of 100000" in refusal(path)
    root["accessors"].append(root["accessors"][primitive["attributes"]["POSITION"]] | {"count": 3 * 10**8})
    root["meshes"][-1]["primitives"] = [{"attributes": {"POSITION": len(root["accessors"]) - 1}}]
    path.write_bytes(pack_glb(root, bytes(binary)))
    assert "triangles, more than the limit of 50000000" in refusal(path)


def test_a_deep_chain_loads(tmp_path):
    root, binary = parts()
    first = len(root["nodes"])
    root["nodes"] += [{"children": [first + k + 1]} for k in range(4999)] + [{"mesh": 0}]
    root["scenes"][0]["nodes"] = [1, 2, first]
    (tmp_path / "deep.glb").write_bytes(pack_glb(root, bytes(binary)))
    assert len(load_scene(tmp_path / "deep.glb").world().triangles) == 2


def test_an_empty_file_loads_and_says_so_when_rendered(tmp_path):
    (tmp_path / "empty.glb").write_bytes(pack_glb({"asset": {"version": "2.0"}}, b""))
    scene = load_scene(tmp_path / "empty.glb")
    assert scene.notes == ("scene has no geometry",)
    with pytest.raises(SceneError, match="no geometry"):
        scene.world()


def test_doubled_light_is_single(tmp_path):
    b = SceneBuilder("s")
    lamp = b.material(Lambert("lamp", emission=(1.0, 1.0, 1.0), double_sided=False))
    corners = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
    faces = [[0, 1, 2], [0, 2, 3]]
    b.node(meshes=(b.mesh(corners, faces * 2, lamp),))
    b.camera((0, 1, 4), (0, 0, 0), 0.8)
    (tmp_path / "s.glb").write_bytes(gltf_bytes(b.build()))
    scene = load_scene(tmp_path / "s.glb")
    assert "2 duplicate triangles dropped" in scene.notes
    world = scene.world()
    assert world.areas[world.emissive].sum() / world.scale**2 == pytest.approx(4)


# deadline: a first example pays for imports
@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_random_damage_is_refused_or_loads(tmp_path_factory, damage):
    data = bytearray(GOOD)
    for at, value in damage:
        data[at] = value
    path = tmp_path_factory.getbasetemp() / "fuzz.glb"
    path.write_bytes(data)
    message = ""
    try:
        scene = load_scene(path)
        scene.world()
    except SceneError as error:
        message = str(error)
    assert "\n" not in message
    if not message:
        assert all(np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all() for mesh in scene.meshes)


def broken_folder():
    folders = [Path(os.environ["LUXMETER_SCENES"])] if "LUXMETER_SCENES" in os.environ else []
    return next((f / "broken" for f in [*folders, ROOT.parent / "shared" / "scenes"] if (f / "broken").is_dir()), None)


ANSWERS = {
    "00_good": None,
    "01_nan_position": "vertex 5: POSITION is not finite",
    "02_inf_and_zero_normals": ["2 normals not finite or zero: computed from the faces"],
    "03_zero_area": ["3 zero-area triangles dropped"],
    "04_index_out_of_range": "accessors[2]: index 60000",
    "05_truncated": "header: says 1568 bytes, the file has 1498",
    "06_truncated_header": "not a GLB",
    "07_lying_total_length": "the file has 1568",
    "08_lying_chunk_length": "are left",
    "09_lying_accessor_count": "bufferViews[0] has 84",
    "10_path_traversal_uri": "external URI '../../etc/passwd'",
    "11_http_uri": "external URI 'http:",
    "12_empty_scene": "scene has no geometry",
    "13_no_camera": ["no camera: a view is framed from the bounding box"],
    "14_no_light": ["no light: the image is black"],
    "15_scale_1e30": "half diagonal 1.5e+30 m",
    "16_scale_1e-30": "half diagonal 1.5e-30 m",
    "17_duplicate_faces": ["4 duplicate triangles dropped"],
    "18_flipped_normals": ["3 triangles have normals against their winding"],
    "19_non_indexed": None,
    "20_deep_nesting_5000": ["nodes outside the active scene are dropped (1 nodes)"],
    "21_cyclic_nodes": "cycle",
    "22_node_two_parents": "two parents",
    "23_zero_fov": "yfov must lie in",
    "24_unknown_required_extension": "KHR_draco_mesh_compression",
    "25_not_a_glb": "not a GLB",
    "26_json_nan": "NaN is not JSON",
}


@pytest.mark.skipif(broken_folder() is None, reason="folder of broken scenes not present (LUXMETER_SCENES)")
@pytest.mark.parametrize("name", sorted(ANSWERS))
def test_collected_broken_files(name):
    path = broken_folder() / f"{name}.glb"
    answer = ANSWERS[name]
    if isinstance(answer, str) and name != "12_empty_scene":
        assert answer in refusal(path)
        return
    scene = load_scene(path)
    if isinstance(answer, str):
        with pytest.raises(SceneError, match=answer):
            scene.world()
        return
    assert list(scene.notes) == (answer or [])
    assert len(scene.world().triangles) == 3
    assert scene.needs >= {"diffuse"}


@pytest.mark.skipif(broken_folder() is None, reason="folder of broken scenes not present (LUXMETER_SCENES)")
def test_every_collected_file_has_an_answer():
    assert {path.stem for path in broken_folder().glob("*.glb")} == set(ANSWERS)
