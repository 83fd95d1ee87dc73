"""The hash is the scene's identity: every image-changing field counts, names don't, and processes agree."""

import subprocess
import sys
from dataclasses import replace

import numpy as np

from renderers.scene.model import (
    GGX,
    Camera,
    Channel,
    Environment,
    Lambert,
    Mesh,
    Node,
    Phong,
    PointLight,
    Scene,
    SpotLight,
    Texture,
)


def rich_scene():
    mesh = Mesh(
        "m",
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32),
        np.array([[0, 0, 1]] * 3, np.float32),
        np.array([[0, 1, 2]], np.uint32),
        0,
        np.zeros((3, 2), np.float32),
    )
    return Scene(
        "rich",
        meshes=(mesh,),
        materials=(Lambert(), Phong(), GGX()),
        textures=(Texture("t", np.zeros((2, 2, 3), np.uint8)),),
        nodes=(Node(meshes=(0,)), Node(camera=0, parent=0), Node(light=0)),
        lights=(PointLight(), SpotLight()),
        cameras=(Camera(),),
        channels=(Channel("node", 0, "translation", np.array([0.0, 1.0]), np.zeros((2, 3))),),
        environment=Environment(image=np.ones((2, 4, 3), np.float32)),
    )


def changed(scene, field, index, **new):
    parts = list(getattr(scene, field))
    parts[index] = replace(parts[index], **new)
    return replace(scene, **{field: tuple(parts)})


def test_every_field_that_changes_an_image_changes_the_hash():
    s = rich_scene()
    one = np.ones((2, 3))
    variants = [
        replace(s, fps=25.0),
        replace(s, exposure=2.0),
        replace(s, environment=None),
        replace(s, environment=replace(s.environment, radiance=(1, 1, 2))),
        replace(s, environment=replace(s.environment, image=None)),
        replace(s, environment=replace(s.environment, rotation=(0, 1, 0, 0))),
        replace(s, nodes=s.nodes[:2]),
        changed(s, "meshes", 0, positions=s.meshes[0].positions + np.float32(1)),
        changed(s, "meshes", 0, normals=-s.meshes[0].normals),
        changed(s, "meshes", 0, triangles=s.meshes[0].triangles[:, ::-1]),
        changed(s, "meshes", 0, material=1),
        changed(s, "meshes", 0, uvs=None),
        changed(s, "materials", 0, albedo=(0.8, 0.8, 0.9)),
        changed(s, "materials", 0, texture=0),
        changed(s, "materials", 0, emission=(0, 0, 1e-9)),
        changed(s, "materials", 0, double_sided=False),
        changed(s, "materials", 1, exponent=21.0),
        changed(s, "materials", 2, roughness=0.5),
        changed(s, "textures", 0, pixels=s.textures[0].pixels + np.uint8(1)),
        changed(s, "textures", 0, wrap=("clamp", "repeat")),
        changed(s, "nodes", 0, translation=(0, 0, 1e-12)),
        changed(s, "nodes", 1, parent=None),
        changed(s, "nodes", 0, matrix=tuple(np.eye(4).ravel())),
        changed(s, "lights", 0, intensity=2.0),
        changed(s, "lights", 1, outer_angle=0.5),
        replace(s, lights=s.lights[::-1]),
        changed(s, "cameras", 0, yfov=0.81),
        changed(s, "channels", 0, values=one),
        changed(s, "channels", 0, times=np.array([0.0, 2.0])),
        changed(s, "channels", 0, interpolation="STEP"),
        changed(s, "channels", 0, path="scale"),
    ]
    hashes = [s.hash, *(v.hash for v in variants)]
    assert len(set(hashes)) == len(hashes)


def test_names_notes_extras_and_parameters_do_not_count():
    s = rich_scene()
    other = replace(s, name="else", notes=("note",), parameters={"a": 1})
    for field in ("meshes", "materials", "textures", "nodes", "lights", "cameras"):
        other = changed(other, field, 0, name="else")
    other = changed(changed(other, "nodes", 0, extras="{}"), "materials", 0, extras="[1]")
    assert other.hash == s.hash


def test_integers_and_floats_of_one_value_are_one_number():
    s = rich_scene()
    assert changed(s, "nodes", 0, translation=(1, 2, 3)).hash == changed(s, "nodes", 0, translation=(1.0, 2.0, 3.0)).hash


def test_hash_is_the_same_in_another_process():
    code = "import renderers; print(renderers.load_scene('cornell-box').hash)"
    hashes = {
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={"PYTHONHASHSEED": seed}
        ).stdout
        for seed in ("1", "2")
    }
    assert len(hashes) == 1
    assert len(hashes.pop().strip()) == 64
