"""Scene to .glb and back loses nothing: equal hash, names, extras, notes."""

import json
import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderers.scene.builtin import BUILTIN
from renderers.scene.gltf import read_gltf, write_gltf
from renderers.scene.gltf.write import gltf_bytes
from renderers.scene.model import (
    GGX,
    Camera,
    Channel,
    DirectionalLight,
    DiscLight,
    Environment,
    Lambert,
    Mesh,
    Node,
    Phong,
    PointLight,
    Scene,
    SceneError,
    SphereLight,
    SpotLight,
    Texture,
)

names = st.text(st.characters(exclude_categories=["Cs"]), max_size=5)
unit = st.floats(0, 1)
# radiance below 1e-30 W/sr/m² could leave the normal numbers when it is split into factor and strength
positive = st.just(0.0) | st.floats(1e-30, 1e6)
coordinate = st.floats(-1e3, 1e3)
colors = st.tuples(unit, unit, unit)
lights_rgb = st.tuples(positive, positive, positive)
json_values = st.recursive(
    st.booleans() | st.integers(-9, 9) | names,
    lambda value: st.lists(value, max_size=2) | st.dictionaries(names, value, max_size=2),
)
extras = st.just("") | json_values.map(lambda value: json.dumps(value, separators=(",", ":")))


@st.composite
def quaternions(draw):
    v = np.array([*draw(st.tuples(*[st.floats(-1, 1)] * 3)), 1.0])
    return tuple(float(x) for x in v / np.linalg.norm(v))


@st.composite
def meshes(draw, materials):
    count = draw(st.integers(1, 3))
    seed = np.random.default_rng(draw(st.integers(0, 999)))
    corners = seed.uniform(-1, 1, (3 * count, 3)).astype(np.float32)
    normals = seed.normal(size=(3 * count, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    uvs = seed.uniform(-2, 2, (3 * count, 2)).astype(np.float32) if draw(st.booleans()) else None
    triangles = np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)
    return Mesh(draw(names), corners, normals, triangles, draw(st.integers(0, materials - 1)), uvs)


def material_of(textures):
    common = {
        "name": names,
        "texture": st.none() | st.integers(0, textures - 1) if textures else st.none(),
        "emission": st.just((0.0, 0.0, 0.0)) | lights_rgb,
        "double_sided": st.booleans(),
        "extras": extras,
    }
    return st.one_of(
        st.builds(Lambert, albedo=colors, **common),
        st.builds(Phong, diffuse=colors, specular=colors, exponent=positive, **common),
        st.builds(GGX, base_color=colors, metallic=unit, roughness=unit, **common),
        st.builds(GGX, base_color=colors, metallic=st.just(0.0), roughness=st.just(1.0), **common),
    )


common_light = {"name": names, "color": lights_rgb, "intensity": positive, "extras": extras}
lights = st.one_of(
    st.builds(PointLight, **common_light),
    st.builds(DirectionalLight, **common_light),
    st.builds(SpotLight, inner_angle=st.floats(0, 0.4), outer_angle=st.floats(0.5, math.pi / 2), **common_light),
    st.builds(DiscLight, radius=st.floats(0.01, 10), **common_light),
    st.builds(SphereLight, radius=st.floats(0.01, 10), **common_light),
)
textures = st.builds(
    lambda name, seed, wrap: Texture(name, np.random.default_rng(seed).integers(0, 256, (2, 3, 3), dtype=np.uint8), wrap),
    names,
    st.integers(0, 99),
    st.tuples(*[st.sampled_from(["repeat", "clamp", "mirror"])] * 2),
)
WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "intensity": 1, "color": 3, "yfov": 1}


@st.composite
def channels(draw, target, index, path):
    mode = draw(st.sampled_from(["STEP", "LINEAR", "CUBICSPLINE"]))
    seed = np.random.default_rng(draw(st.integers(0, 99)))
    keys = draw(st.integers(1, 3))
    times = np.cumsum(seed.uniform(0.1, 1, keys))
    values = seed.uniform(0.1, 1, (keys, WIDTHS[path]))
    if path == "rotation":
        values /= np.linalg.norm(values, axis=1, keepdims=True)
    if draw(st.booleans()):
        # numbers that float32 holds go another way than those it doesn't
        times, values = times.astype(np.float32).astype(np.float64), values.astype(np.float32).astype(np.float64)
    if mode == "CUBICSPLINE":
        values = np.stack([seed.normal(size=values.shape), values, seed.normal(size=values.shape)], axis=1)
    return Channel(target, index, path, times, values, mode)


@st.composite
def nodes(draw, count, mesh_count, light_count, camera_count):
    made = []
    for index in range(count):
        matrix = draw(st.none() | st.just(tuple(float(v) for v in (2, 0, 0, 0, 0, 0, -1, 0, 0, 3, 0, 0, 0.1, -7, 1, 1))))
        place = {} if matrix else {
            "translation": draw(st.tuples(coordinate, coordinate, coordinate)),
            "rotation": draw(quaternions()),
            "scale": draw(st.tuples(*[st.floats(0.1, 3)] * 3)),
        }  # fmt: skip
        made.append(Node(
            name=draw(names), matrix=matrix, extras=draw(extras), **place,
            parent=draw(st.none() | st.integers(index + 1, count - 1)) if index + 1 < count else None,
            meshes=tuple(draw(st.lists(st.integers(0, mesh_count - 1), max_size=3))),
            light=draw(st.none() | st.integers(0, light_count - 1)) if light_count else None,
            camera=draw(st.none() | st.integers(0, camera_count - 1)),
        ))  # fmt: skip
    return (*made, Node(camera=0, meshes=(0,)))


@st.composite
def scenes(draw):
    texture = draw(st.lists(textures, max_size=2))
    material = draw(st.lists(material_of(len(texture)), min_size=1, max_size=3))
    mesh = draw(st.lists(meshes(len(material)), min_size=1, max_size=3))
    light = draw(st.lists(lights, max_size=2))
    camera = draw(st.lists(st.builds(Camera, names, st.floats(0.1, 3), extras), min_size=1, max_size=2))
    node = draw(nodes(draw(st.integers(0, 3)), len(mesh), len(light), len(camera)))
    targets = [("node", i, p) for i, n in enumerate(node) if n.matrix is None for p in ("translation", "rotation", "scale")]
    targets += [("light", i, p) for i in range(len(light)) for p in ("intensity", "color")]
    targets += [("camera", i, "yfov") for i in range(len(camera))]
    moved = draw(st.lists(st.sampled_from(targets), unique=True, max_size=3))
    image = draw(st.none() | st.just(np.linspace(0, 9, 24, dtype=np.float32).reshape(2, 4, 3)))
    return Scene(
        name=draw(names),
        meshes=tuple(mesh),
        materials=tuple(material),
        textures=tuple(texture),
        nodes=node,
        lights=tuple(light),
        cameras=tuple(camera),
        channels=tuple(draw(channels(*target)) for target in moved),
        environment=draw(st.none() | st.builds(Environment, lights_rgb, st.just(image), quaternions())),
        fps=draw(st.floats(1, 120)),
        exposure=draw(st.none() | st.floats(1e-3, 1e3)),
        notes=tuple(draw(st.lists(names, unique=True, max_size=2))),
        parameters=draw(st.dictionaries(names, st.integers(-9, 9) | names, max_size=2)),
    )


def said(scene):
    """All names and extras of a scene."""
    parts = [*scene.meshes, *scene.materials, *scene.textures, *scene.nodes, *scene.lights, *scene.cameras]
    return [(p.name, p.extras if any(f.name == "extras" for f in fields(p)) else None) for p in parts]


# deadline: the first example pays for the imports; 60 examples cover every strategy branch in about 10 s
@settings(max_examples=60, deadline=None)
@given(scenes())
def test_scenes_come_back_as_they_were(tmp_path_factory, scene):
    path = tmp_path_factory.getbasetemp() / "round.glb"
    write_gltf(scene, path)
    back = read_gltf(path)
    assert back.hash == scene.hash
    assert said(back) == said(scene)
    assert (back.name, back.parameters) == (scene.name, scene.parameters)
    assert back.notes[: len(scene.notes)] == scene.notes
    assert back.needs == scene.needs
    write_gltf(back, path)
    again = read_gltf(path)
    assert (again.hash, said(again), again.notes) == (back.hash, said(back), back.notes)


@pytest.mark.parametrize("name", sorted(BUILTIN))
def test_built_in_scenes_come_back(name, tmp_path):
    scene = BUILTIN[name]()
    write_gltf(scene, tmp_path / "scene.glb")
    back = read_gltf(tmp_path / "scene.glb")
    assert (back.hash, back.name, said(back)) == (scene.hash, scene.name, said(scene))


def test_equal_scenes_give_equal_bytes():
    assert gltf_bytes(BUILTIN["cornell-box"]()) == gltf_bytes(BUILTIN["cornell-box"]())


def test_round_lights_stand_beside_an_approximation(tmp_path):
    scene = Scene("s", lights=(DiscLight("d", intensity=2.0, radius=0.5), SphereLight("s", intensity=3.0, radius=2.0)))
    data = gltf_bytes(scene)
    text = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    disc, sphere = text["extensions"]["KHR_lights_punctual"]["lights"]
    assert (disc["type"], sphere["type"]) == ("spot", "point")
    assert disc["intensity"] == pytest.approx(2 * math.pi * 0.25)
    assert sphere["intensity"] == pytest.approx(3 * math.pi * 4)


def test_what_gltf_cannot_hold_is_refused(tmp_path):
    for part in ({"materials": (Lambert("m", albedo=(2, 0, 0)),)}, {"lights": (SpotLight("l", outer_angle=2.0),)}):
        with pytest.raises(SceneError, match="must"):
            gltf_bytes(Scene("s", **part))
    with pytest.raises(SceneError, match=r"only \.glb"):
        write_gltf(Scene("s"), tmp_path / "scene.gltf")
    with pytest.raises(SceneError, match="JSON text"):
        gltf_bytes(Scene("s", nodes=(Node("n", extras="{"),)))
