"""Ray casting: hits, shadow segments, offsets, caches."""

import gc
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

import renderers
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import DiscLight, Lambert, Scene
from renderers.scene.world import World
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import _CASTERS, CACHED_WORLDS, OFFSET, RayCaster, caster_of, off_surface, segments_blocked


def quad(size: float = 1.0) -> World:
    b = SceneBuilder("quad")
    b.quad(np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]) * size, b.material(Lambert("grey")))
    b.camera((0, 3 * size, 0.001 * size), (0, 0, 0), 1.0)
    return b.build().world()


def test_hits_carry_barycentrics_of_the_second_and_third_vertex() -> None:
    world = quad()
    rng = np.random.default_rng(1)
    target = np.stack([rng.uniform(-0.7, 0.7, 100), np.zeros(100), rng.uniform(-0.7, 0.7, 100)], axis=1)
    origin = np.array([0.3, 1.0, 0.2])
    hits = RayCaster(world).first_hit(np.tile(origin, (100, 1)), target - origin)
    assert (hits.triangle >= 0).all()
    np.testing.assert_allclose(hits.t, 1, atol=1e-5)
    corners = world.positions[world.triangles[hits.triangle]]
    point = (1 - hits.u - hits.v)[:, None] * corners[:, 0] + hits.u[:, None] * corners[:, 1] + hits.v[:, None] * corners[:, 2]
    np.testing.assert_allclose(point, target, atol=1e-6)


def test_misses_are_minus_one_and_zero() -> None:
    hits = RayCaster(quad()).first_hit([[0, 1, 0]], [[0, 1, 0]])
    assert (hits.triangle[0], hits.t[0], hits.u[0], hits.v[0]) == (-1, 0, 0, 0)


def test_occlusion_ends_at_the_distance() -> None:
    caster = RayCaster(quad())
    origins, down = np.tile([0.1, 0.5, 0.2], (4, 1)), np.tile([0.0, -1.0, 0.0], (4, 1))
    assert caster.occluded(origins, down, [0.4, 0.499, 0.501, np.inf]).tolist() == [False, False, True, True]


def test_segments_leave_their_own_surfaces() -> None:
    world = quad()
    caster = RayCaster(world)
    points, up = np.array([[0.2, 0.0, 0.3]]), np.array([[0.0, 1.0, 0.0]])
    for target in ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [5.0, 1e-3, 0.0]):
        assert not segments_blocked(caster, points, up, [target]).any()
    assert segments_blocked(caster, [[0.0, 1.0, 0.0]], up, [[0.1, -1.0, 0.0]]).all()
    assert not segments_blocked(caster, [[0.0, 1.0, 0.0]], up, [[0.1, 0.0, 0.0]], up).any()


def test_offset_follows_the_side() -> None:
    up = np.array([[0.0, 1.0, 0.0]])
    assert off_surface(np.zeros((1, 3)), up, [[1.0, 0.1, 0.0]])[0, 1] == OFFSET
    assert off_surface(np.zeros((1, 3)), up, [[1.0, -0.1, 0.0]])[0, 1] == -OFFSET


def test_casters_are_cached_bounded_and_die_with_their_world() -> None:
    worlds = [quad() for _ in range(CACHED_WORLDS + 2)]
    casters = [caster_of(w) for w in worlds]
    assert caster_of(worlds[-1]) is casters[-1]
    assert len(_CASTERS) <= CACHED_WORLDS
    before = len(_CASTERS)
    last = worlds.pop()
    del last
    gc.collect()
    assert len(_CASTERS) == before - 1


def test_gbuffer_of_the_cornell_box() -> None:
    world = renderers.load_scene("cornell-box").world()
    g = cast_gbuffer(world, (48, 27))
    seen = g.covered
    assert 0.3 < seen.mean() < 0.7
    assert not g.position[~seen].any()
    assert (g.material[~seen] == -1).all()
    view = g.eye - g.position[seen]
    assert (np.einsum("ij,ij->i", g.normal[seen], view) >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(g.normal[seen], axis=1), 1, atol=1e-6)
    # Each position lies on its pixel's ray and in the plane of its triangle, to float32 (world of size 1, camera 3 away).
    _, directions = world.camera.rays((48, 27))
    along = np.cross(g.position[seen] - g.eye, directions[seen])
    assert np.abs(along).max() < 2e-6
    corner = world.positions[world.triangles[g.triangle[seen], 0]]
    normal = world.face_normals[g.triangle[seen]]
    assert np.abs(np.einsum("ij,ij->i", g.position[seen] - corner, normal)).max() < 2e-6


def test_emission_towards_the_viewer() -> None:
    def emission(double_sided: bool, below: bool) -> float:
        b = SceneBuilder("emitter")
        lamp = b.material(Lambert("lamp", emission=(2.0, 2.0, 2.0), double_sided=double_sided))
        b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], lamp)
        b.camera((0, -3 if below else 3, 0.1), (0, 0, 0), 0.5)
        scene: Scene = b.build()
        return float(cast_gbuffer(scene.world(), (3, 3)).emission[1, 1, 0])

    assert emission(False, below=False) == 2
    assert emission(False, below=True) == 0
    assert emission(True, below=True) == 2


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_scale_changes_nothing(scale: float) -> None:
    one, other = cast_gbuffer(quad(), (16, 9)), cast_gbuffer(quad(scale), (16, 9))
    np.testing.assert_array_equal(one.triangle, other.triangle)
    np.testing.assert_allclose(one.position, other.position, atol=1e-6)


def two_boxes(path: Literal["translation", "scale"] = "translation") -> Scene:
    """A still box and one that moves a metre a frame, or turns with its parent; a lamp hangs over the still one."""
    b = SceneBuilder("two boxes")
    grey = b.material(Lambert("grey"))
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
    box = b.mesh(corners, faces, grey)
    b.node(meshes=(box,), translation=(-3, 0, 0))
    parent = b.node(translation=(3, 0, 0))
    b.node(meshes=(box,), parent=parent, translation=(0.5, 0, 0))
    b.light(DiscLight("lamp", intensity=1.0, radius=2.0), (-3, 4, 0))
    b.camera((0, 2, 12), (0, 0, 0), 1.0)
    b.animate(parent, path, [0, 4 / 24], [[3, 0, 0], [7, 4, 0]] if path == "translation" else [[1, 1, 1], [0, 0, 0]])
    return b.build()


@pytest.mark.parametrize("path", ["translation", "scale"])
def test_frames_of_an_animated_scene_share_the_tree_of_what_stands_still(path: Literal["translation", "scale"]) -> None:
    """Hits and shadows are those of a tree over everything; in frame 4 a box has shrunk to nothing."""
    scene, rng = two_boxes(path), np.random.default_rng(4)
    origins, directions = rng.uniform(-1.5, 1.5, (4000, 3)), rng.normal(size=(4000, 3))
    shared, ends = set(), rng.uniform(0, 2, 4000)
    for frame in range(5):
        world = scene.world(frame)
        together, alone = caster_of(world), RayCaster(world)
        assert (len(together._trees), len(alone._trees)) == (1 if path == "scale" and frame == 4 else 2, 1)
        shared.add(id(together._trees[0]._tree))
        found, expected = together.first_hit(origins, directions), alone.first_hit(origins, directions)
        assert len(np.unique(world.instance[found.triangle[found.triangle >= 0]])) == len(np.unique(world.instance))
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(together.occluded(origins, directions, ends), alone.occluded(origins, directions, ends))
    assert len(shared) == 1


def test_worlds_made_by_hand_share_nothing() -> None:
    world = two_boxes().world(2)
    fewer = replace(world, triangles=world.triangles[3:], material=world.material[3:], instance=world.instance[3:])
    assert len(caster_of(world)._trees) == 2
    assert len(caster_of(fewer)._trees) == 1
