"""Scenes in the input format of the Radiance system."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import renderers
from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box
from renderers.scene.model import GGX, DirectionalLight, Lambert, Material, PointLight, Scene, SceneError, SpotLight
from renderers.scene.radiance import view_arguments, write_radiance


def scene(material: Material, light: PointLight | DirectionalLight | SpotLight | None = None) -> Scene:
    b = SceneBuilder("one-box")
    b.place(box((-1, -1, -1), (1, 1, 1)), b.material(material), "box")
    if light is not None:
        b.light(light, (0, 0, 3))
    b.camera((0, -4, 0), (0, 0, 0), 1.0, (0, 0, 1))
    return b.build()


def primitives(path: Path) -> list[list[str]]:
    return [line.split() for line in path.read_text().splitlines()]


def test_every_triangle_material_and_light_is_written(tmp_path: Path) -> None:
    world = scene(Lambert("grey", (0.25, 0.5, 0.75)), PointLight("lamp", (1.0, 0.5, 0.0), 2.0)).world()
    exported = write_radiance(world, tmp_path / "out")
    lines = primitives(exported.scene)
    assert exported.meshes == ()
    polygons = [line for line in lines if line[1] == "polygon"]
    corners = np.array([[float(x) for x in line[6:]] for line in polygons]).reshape(-1, 3, 3)
    np.testing.assert_allclose(corners, world.positions[world.triangles], atol=1e-7)
    plastic = next(line for line in lines if line[1] == "plastic")
    assert [float(x) for x in plastic[6:]] == [0.25, 0.5, 0.75, 0, 0]
    bulb = next(line for line in lines if line[1] == "sphere")
    radiance = next(line for line in lines if line[1] == "light")
    area = np.pi * float(bulb[9]) ** 2  # seen from afar: intensity is radiance times that
    np.testing.assert_allclose(np.array(radiance[6:], float) * area, world.lights[0].intensity, rtol=1e-6)


def test_smooth_surfaces_become_meshes_with_their_normals(tmp_path: Path) -> None:
    world = scene(Lambert("grey", (0.5,) * 3)).world()
    leaning = world.normals + np.float32([0.3, 0.2, 0.1])
    world = replace(world, normals=(leaning / np.linalg.norm(leaning, axis=1, keepdims=True)).astype(np.float32))
    exported = write_radiance(world, tmp_path)
    (mesh,) = exported.meshes
    kinds = [line.split() for line in mesh.read_text().splitlines()]
    normals = np.array([line[1:] for line in kinds if line[0] == "vn"], float)
    assert len([line for line in kinds if line[0] == "f"]) == len(world.triangles)
    assert {tuple(np.round(n, 5)) for n in normals} == {tuple(np.round(n, 5)) for n in world.normals.astype(float)}
    assert any(line[1] == "mesh" and line[4] == "m0.rtm" for line in primitives(exported.scene))


def test_a_sun_has_the_irradiance_of_the_directional_light(tmp_path: Path) -> None:
    world = scene(Lambert("grey", (0.5,) * 3), DirectionalLight("sun", (1.0, 1.0, 1.0), 3.0)).world()
    lines = primitives(write_radiance(world, tmp_path).scene)
    sun = next(line for line in lines if line[1] == "source")
    np.testing.assert_allclose(np.array(sun[6:9], float), -world.lights[0].direction, atol=1e-8)
    solid_angle = np.pi * np.sin(np.radians(float(sun[9]) / 2)) ** 2
    radiance = np.array(next(line for line in lines if line[1] == "light")[6:], float)
    np.testing.assert_allclose(radiance * solid_angle, 3.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("odd", "what"),
    [
        (scene(GGX("metal", (0.5,) * 3, 1.0, 0.3)), "glossy"),
        (scene(Lambert("grey", (0.5,) * 3), SpotLight("spot", (1.0,) * 3, 1.0)), "spot lights"),
    ],
)
def test_what_has_no_counterpart_is_refused(odd: Scene, what: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=what):
        write_radiance(odd.world(), tmp_path)


def test_the_view_is_the_camera() -> None:
    camera = renderers.load_scene("cornell-box").world().camera
    options = view_arguments(camera, (64, 32))
    at = {name: options.index(name) for name in ("-vp", "-vd", "-vh", "-vv")}
    origins, directions = camera.rays((64, 32))
    np.testing.assert_allclose(np.array(options[at["-vp"] + 1 :][:3], float), origins[0, 0], atol=1e-8)
    forward = np.array(options[at["-vd"] + 1 :][:3], float)
    np.testing.assert_allclose(forward, directions.mean(axis=(0, 1)) / np.linalg.norm(directions.mean(axis=(0, 1))), atol=1e-6)
    half_height, half_width = (np.tan(np.radians(float(options[at[name] + 1]) / 2)) for name in ("-vv", "-vh"))
    assert half_width == pytest.approx(2 * half_height)
