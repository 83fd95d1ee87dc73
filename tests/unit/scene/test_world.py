"""The World: normalised, outward wound, exact in area, the same whatever the unit of length."""

from dataclasses import replace

import numpy as np
import pytest

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import (
    GGX,
    DirectionalLight,
    DiscLight,
    Lambert,
    Node,
    Phong,
    PointLight,
    Scene,
    SceneError,
    SphereLight,
    SpotLight,
    Texture,
)
from renderers.scene.shapes import sphere
from renderers.scene.transforms import global_matrices, rest_bounds
from renderers.scene.world import GGX_KIND, LAMBERT, PHONG

EPS = float(np.finfo(np.float32).eps)


def ball_scene(scale=1.0, **node):
    """A ball at (3, 0, 0) · scale above a square, a point and a spot light, a camera."""
    b = SceneBuilder("ball")
    material = b.material(Lambert())
    b.quad(np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]) * scale, material)
    p, n, t = sphere(0.5, 12, 6)
    b.node(meshes=(b.mesh(p * np.float32(scale), t, material, n),), **{"translation": (3 * scale, scale, 0), **node})
    b.light(PointLight("", (1, 0.5, 0.25), 8.0 * scale**2), (0, 2 * scale, 0))
    b.light(SpotLight("", intensity=3.0 * scale**2, inner_angle=0.2, outer_angle=0.6), (0, 3 * scale, 0))
    b.light(DirectionalLight("", intensity=5.0))
    b.camera(np.array((0, 1, 6)) * scale, (0, 0, 0), 0.8)
    return b.build()


def test_normalisation_puts_the_bounding_sphere_at_one():
    world = ball_scene(7.0).world()
    low, high = world.positions.min(axis=0), world.positions.max(axis=0)
    # corners are rounded to float32 once
    assert (low + high) / 2 == pytest.approx(np.zeros(3), abs=2 * EPS)
    assert np.linalg.norm(high - low) / 2 == pytest.approx(1, abs=4 * EPS)


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_the_world_does_not_depend_on_the_unit_of_length(scale):
    one, other = ball_scene(1.0).world(), ball_scene(scale).world()
    # positions are rounded to float32 in the mesh and again in the World: two half-ulps at |p| <= 1, plus the centre's
    assert other.positions == pytest.approx(one.positions, abs=4 * EPS)
    assert other.normals == pytest.approx(one.normals, abs=4 * EPS)
    assert np.array_equal(other.triangles, one.triangles)
    assert other.camera.pose == pytest.approx(one.camera.pose, abs=8 * EPS)
    for a, b in zip(one.lights, other.lights, strict=True):
        assert b.intensity == pytest.approx(a.intensity, rel=8 * EPS)
        assert b.position == pytest.approx(a.position, abs=8 * EPS)
    assert other.scale * scale == pytest.approx(one.scale, rel=4 * EPS)


def test_intensities_scale_with_the_square_of_length_and_irradiance_does_not():
    world = ball_scene().world()
    point, spot, sun = world.lights
    assert point.intensity == pytest.approx(np.array((8, 4, 2)) * world.scale**2)
    assert spot.intensity == pytest.approx(np.full(3, 3.0) * world.scale**2)
    assert (spot.cos_inner, spot.cos_outer) == pytest.approx((np.cos(0.2), np.cos(0.6)))
    assert sun.intensity == pytest.approx(np.full(3, 5.0))
    assert sun.direction == pytest.approx((0, 0, -1))


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (2, -0.5, 1), (-1, -1, -3)])
def test_mirrored_instances_keep_their_front_outside(scale):
    world = scaled_ball(scale).world()
    ball = np.flatnonzero(world.instance == 1)
    corners = world.positions[world.triangles[ball]].astype(np.float64)
    outwards = corners.mean(axis=1) - corners.mean(axis=(0, 1))
    assert (np.sum(world.face_normals[ball] * outwards, axis=1) > 0).all()
    assert (np.sum(world.normals[world.triangles[ball]].mean(axis=1) * outwards, axis=1) > 0).all()
    assert np.linalg.norm(world.normals, axis=1) == pytest.approx(np.ones(len(world.normals)), abs=4 * EPS)


def scaled_ball(scale):
    scene = ball_scene()
    nodes = list(scene.nodes)
    nodes[1] = replace(nodes[1], scale=scale)
    return replace(scene, nodes=tuple(nodes))


def test_normals_of_a_stretched_sphere_are_those_of_the_ellipsoid():
    world = scaled_ball((2.0, 1.0, 0.5)).world()
    used = np.unique(world.triangles[world.instance == 1])
    metres = world.positions[used] / world.scale + world.centre - (3, 1, 0)
    gradient = metres / np.array((2.0, 1.0, 0.5)) ** 2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    assert world.normals[used] == pytest.approx(gradient, abs=1e-5)  # float32 positions at distance 3, divided by radius 0.25


def test_an_instance_scaled_to_nothing_vanishes_and_one_scaled_flat_stays():
    whole = scaled_ball((1, 1, 1)).world()
    gone, flat = scaled_ball((0, 0, 0)).world(), scaled_ball((1, 0, 1)).world()
    assert len(gone.triangles) == 2
    assert 2 < len(flat.triangles) <= len(whole.triangles)
    assert np.isfinite(flat.normals).all()
    assert (np.abs(flat.face_normals[flat.instance == 1][:, 1]) > 0.999).all()


@pytest.mark.parametrize(("light", "area"), [(DiscLight(radius=0.7), np.pi * 0.49), (SphereLight(radius=0.7), 4 * np.pi * 0.49)])
def test_round_lights_have_exactly_their_area(light, area):
    b = SceneBuilder("s")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert()))
    b.light(replace(light, color=(1, 2, 3), intensity=4.0), (0, 2, 0))
    b.camera((0, 1, 6), (0, 0, 0), 0.8)
    world = b.build().world()
    assert world.areas[world.emissive].sum() / world.scale**2 == pytest.approx(area, rel=1e-6)
    assert world.materials.emission[world.material[world.emissive[0]]].tolist() == [4, 8, 12]
    assert not world.materials.emits_both[world.material[world.emissive[0]]]
    assert world.lights == ()


def test_disc_lights_shine_along_minus_z():
    b = SceneBuilder("s")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert()))
    b.light(DiscLight())
    b.camera((0, 1, 6), (0, 0, 0), 0.8)
    world = b.build().world()
    assert world.face_normals[world.emissive] == pytest.approx(np.tile((0, 0, -1), (len(world.emissive), 1)), abs=1e-6)


def test_material_table_rows():
    b = SceneBuilder("s")
    for material in (Lambert("", (0.1, 0.2, 0.3)), Phong(exponent=9.0), GGX(roughness=0.5, metallic=0.25), GGX(roughness=0.0)):
        b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(material))
    b.camera((0, 1, 6), (0, 0, 0), 0.8)
    table = b.build().world().materials
    assert table.kind.tolist() == [LAMBERT, PHONG, GGX_KIND, GGX_KIND]
    assert table.base[0] == pytest.approx((0.1, 0.2, 0.3))
    assert table.exponent.tolist() == [0, 9, 0, 0]
    assert table.alpha.tolist() == pytest.approx([1, 1, 0.25, 1e-3])
    assert table.metallic.tolist() == [0, 0, 0.25, 1]
    assert table.texture.tolist() == [-1] * 4


def test_camera_is_rigid_whatever_its_node_does():
    scene = ball_scene()
    nodes = list(scene.nodes)
    nodes[-1] = replace(nodes[-1], scale=(-2.0, 3.0, 0.5))
    pose = replace(scene, nodes=tuple(nodes)).world().camera.pose
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert pose[:3, 2] == pytest.approx(scene.world().camera.pose[:3, 2])


def test_rays_pass_through_pixel_centres_with_row_0_on_top():
    camera = ball_scene().world().camera
    origins, directions = camera.rays((4, 2))
    assert origins.shape == directions.shape == (2, 4, 3)
    local = directions @ camera.pose[:3, :3]
    assert (local[0, :, 1] > 0).all()
    assert (local[:, 0, 0] < 0).all()
    tangent = local[..., 1] / -local[..., 2]
    assert tangent[0] == pytest.approx(np.full(4, np.tan(0.4) / 2))


def test_clip_contains_all_that_is_in_front():
    world = ball_scene().world()
    near, far = world.clip
    depth = -(world.positions - world.camera.pose[:3, 3]) @ world.camera.pose[:3, 2]
    assert 0 < near <= max(depth.min(), far * 1e-4)
    assert depth.max() <= far


def test_refusals_name_what_is_missing():
    scene = ball_scene()
    with pytest.raises(SceneError, match="no camera"):
        replace(scene, nodes=scene.nodes[:-1]).world()
    with pytest.raises(SceneError, match="no geometry"):
        Scene("empty").world()
    with pytest.raises(SceneError, match="cycle"):
        global_matrices((Node(parent=1), Node(parent=0)))


def test_bounds_ignore_vertices_that_no_triangle_uses():
    scene = ball_scene()
    mesh = scene.meshes[0]
    stray = replace(
        mesh,
        positions=np.vstack([mesh.positions, [[1e6, 0, 0]]]).astype(np.float32),
        normals=np.vstack([mesh.normals, [[0, 1, 0]]]).astype(np.float32),
    )
    assert rest_bounds(replace(scene, meshes=(stray, *scene.meshes[1:])))[1] == rest_bounds(scene)[1]


def test_textures_are_linearised_by_the_srgb_curve():
    texture = Texture("t", np.array([[[0, 10, 255]]], np.uint8))
    assert texture.linear[0, 0] == pytest.approx((0, 10 / 255 / 12.92, 1))
    assert Texture("t", np.full((1, 1, 3), 188, np.uint8)).linear[0, 0, 0] == pytest.approx(((188 / 255 + 0.055) / 1.055) ** 2.4)


def test_the_last_world_is_kept():
    scene = ball_scene()
    assert scene.world(0) is scene.world(5)


def test_areas_and_normals_of_some_triangles_are_those_of_all():
    """To the bit, whether the others have been computed or not, and in any order, with repetitions."""
    world = ball_scene().world()
    some = np.array([5, 0, 17, 5, len(world.triangles) - 1])
    areas, normals = world.areas_of(some), world.normals_of(some)
    assert "areas" not in vars(world)
    assert "face_normals" not in vars(world)
    np.testing.assert_array_equal(areas, world.areas[some])
    np.testing.assert_array_equal(normals, world.face_normals[some])
    np.testing.assert_array_equal(world.areas_of(some), areas)
    np.testing.assert_array_equal(world.normals_of(some), normals)
