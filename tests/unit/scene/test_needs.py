"""A scene needs what is placed in it, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import (
    GGX,
    NEEDS,
    Channel,
    DirectionalLight,
    DiscLight,
    Environment,
    Lambert,
    Phong,
    PointLight,
    SphereLight,
    SpotLight,
)

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def scene_of(material=None, light=None):
    b = SceneBuilder("s")
    b.quad(SQUARE, b.material(material or Lambert()))
    if light is not None:
        b.light(light)
    b.camera((0, 0, 3), (0, 0, 0), 0.8)
    return b.build()


@pytest.mark.parametrize(
    ("material", "needs"),
    [
        (Lambert(), {"diffuse"}),
        (Lambert(emission=(0, 0, 1)), {"diffuse", "area_light"}),
        (Phong(), {"diffuse", "glossy"}),
        (Phong(specular=(0, 0, 0)), {"diffuse"}),
        (Phong(diffuse=(0, 0, 0)), {"glossy"}),
        (GGX(metallic=1, roughness=0.5), {"glossy"}),
        (GGX(metallic=0, roughness=0.5), {"diffuse", "glossy"}),
        (GGX(metallic=1, roughness=0.099), {"specular"}),
        (GGX(metallic=1, roughness=0.1), {"glossy"}),
    ],
)
def test_material_needs(material, needs):
    assert scene_of(material).needs == needs


@pytest.mark.parametrize(
    ("light", "need"),
    [
        (PointLight(), {"point_light"}),
        (SpotLight(), {"spot_light"}),
        (DirectionalLight(), {"directional_light"}),
        (DiscLight(), {"area_light"}),
        (SphereLight(), {"area_light"}),
        (PointLight(intensity=0), set()),
        (PointLight(color=(0, 0, 0)), set()),
    ],
)
def test_light_needs(light, need):
    assert scene_of(light=light).needs == {"diffuse"} | need


def test_environment_need():
    assert replace(scene_of(), environment=Environment()).needs == {"diffuse", "environment"}
    assert replace(scene_of(), environment=Environment((0, 0, 0))).needs == {"diffuse"}


def test_what_is_not_placed_is_not_needed():
    scene = scene_of()
    scene = replace(scene, materials=(*scene.materials, Phong(), Lambert(emission=(1, 1, 1))), lights=(PointLight(),))
    assert scene.needs == {"diffuse"}


def channel(index, values=((0, 0, 0), (1, 0, 0)), target="node", path="translation", mode="LINEAR"):
    return Channel(target, index, path, np.array([0.0, 1.0]), np.array(values, np.float64), mode)


def test_animation_needs():
    scene = scene_of(light=PointLight())  # nodes: quad, light, camera
    base = {"diffuse", "point_light"}
    for index, need in enumerate(("animated_geometry", "animated_light", "animated_camera")):
        assert replace(scene, channels=(channel(index),)).needs == base | {need}
    assert replace(scene, channels=(channel(0, ((1,), (2,)), "light", "intensity"),)).needs == base | {"animated_light"}
    assert replace(scene, channels=(channel(0, ((0.5,), (0.6,)), "camera", "yfov"),)).needs == base | {"animated_camera"}


def test_constant_channels_move_nothing_but_swinging_splines_do():
    scene = scene_of()
    assert replace(scene, channels=(channel(0, ((1, 0, 0), (1, 0, 0))),)).needs == {"diffuse"}
    still = [[[0, 0, 0]] * 3] * 2
    swing = [[[0, 0, 0], [0, 0, 0], [1, 0, 0]], [[0, 0, 0]] * 3]
    assert replace(scene, channels=(channel(0, still, mode="CUBICSPLINE"),)).needs == {"diffuse"}
    assert replace(scene, channels=(channel(0, swing, mode="CUBICSPLINE"),)).needs == {"diffuse", "animated_geometry"}


def test_a_moving_parent_moves_its_children():
    b = SceneBuilder("s")
    root = b.node()
    b.node(parent=root, meshes=(b.mesh(SQUARE, [[0, 1, 2]], b.material(Lambert(emission=(1, 0, 0)))),))
    scene = replace(b.build(), channels=(channel(root),))
    assert {"animated_geometry", "animated_light"} < scene.needs <= set(NEEDS)
