"""Ray casting: hits, shadow segments, offsets, caches."""

import gc

import numpy as np
import pytest

import renderers
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, Scene
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
