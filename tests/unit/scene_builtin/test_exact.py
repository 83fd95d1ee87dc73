"""The closed forms against independent quadrature and published values, and the scenes against their formulas' geometry."""

from __future__ import annotations

import numpy as np
import pytest

from renderers import load_scene
from renderers.scene.builtin import exact


def midpoints(low: float, high: float, n: int) -> np.ndarray:
    return low + (high - low) * (np.arange(n) + 0.5) / n


def irradiance_by_quadrature(point, normal, corner, edge_u, edge_v, n=400) -> float:
    """∫ cos θ_p cos θ_s / r² dA over a parallelogram of radiance 1, midpoint rule."""
    u, v = np.meshgrid(midpoints(0, 1, n), midpoints(0, 1, n))
    corner, edge_u, edge_v = (np.asarray(a, float) for a in (corner, edge_u, edge_v))
    area = np.cross(edge_u, edge_v)
    way = corner + u[..., None] * edge_u + v[..., None] * edge_v - np.asarray(point, float)
    r2 = (way**2).sum(-1)
    return float((np.maximum(way @ np.asarray(normal, float), 0) * np.abs(way @ area) / r2**2).mean())


@pytest.mark.parametrize("point", [(0, 0, 0), (0.7, 0, -0.2), (-2.0, 0, 1.5)])
def test_rectangle_against_quadrature(point: tuple[float, float, float]) -> None:
    expected = 3 * irradiance_by_quadrature(point, (0, 1, 0), (-0.5, 1, -0.3), (1, 0, 0), (0, 0, 0.6))
    assert float(exact.rectangle_irradiance(point, radiance=3.0)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("point", [(0, 0, 0), (0.45, 0, 0.1), (0.9, 0, 0.75), (2.5, 0, 0)])
def test_occluded_rectangle_against_quadrature_with_a_shadow_test(point: tuple[float, float, float]) -> None:
    """Midpoint rule over the light, each ray tested against the square at half height; its shadow's edge costs O(1/n)."""
    n, occluder = 1200, 0.4
    x, z = np.meshgrid(midpoints(-0.5, 0.5, n), midpoints(-0.3, 0.3, n))
    way = np.stack([x, np.ones_like(x), z], axis=-1) - np.asarray(point, float)
    half_way = np.asarray(point, float) + way / 2
    free = np.maximum(np.abs(half_way[..., 0]), np.abs(half_way[..., 2])) > occluder / 2
    expected = float((free / (way**2).sum(-1) ** 2).mean() * 0.6)
    assert float(exact.rectangle_irradiance(point, occluder=occluder)) == pytest.approx(expected, rel=3e-3, abs=1e-6)


def test_occluder_wider_than_the_light_leaves_an_umbra_and_never_a_negative_value() -> None:
    points = np.stack(np.broadcast_arrays(np.linspace(-3, 3, 61)[:, None], 0.0, np.linspace(-3, 3, 61)[None, :]), axis=-1)
    value = exact.rectangle_irradiance(points, occluder=1.5)
    assert value.min() >= -1e-12
    assert value[30, 30] == pytest.approx(0, abs=1e-12)
    assert (value <= exact.rectangle_irradiance(points) + 1e-12).all()


def test_polygon_of_a_published_form_factor() -> None:
    """Rectangle with one corner above the point, ½[X/√(1+X²) atan(Y/√(1+X²)) + …]: X = 2.5, Y = 1.875 give 0.66458."""
    corners = [(0, 0.8, 0), (2, 0.8, 0), (2, 0.8, 1.5), (0, 0.8, 1.5)]
    assert float(exact.polygon_irradiance((0, 0, 0), (0, 1, 0), corners)) == pytest.approx(0.66458, abs=1e-5)


def test_polygon_that_fills_the_hemisphere_gives_pi() -> None:
    far = 1e6
    corners = [(-far, 1, -far), (far, 1, -far), (far, 1, far), (-far, 1, far)]
    assert float(exact.polygon_irradiance((0, 0, 0), (0, 1, 0), corners, 2.0)) == pytest.approx(2 * np.pi, rel=1e-5)


def test_parallel_plates_form_factor_is_published_and_is_the_mean_of_the_pointwise_one() -> None:
    assert exact.parallel_plates_form_factor(1.0, 1.0) == pytest.approx(0.1998, abs=5e-5)
    for side, distance in ((1.0, 0.5), (2.0, 0.3), (1.0, 4.0)):
        x, z = np.meshgrid(midpoints(-side / 2, side / 2, 200), midpoints(-side / 2, side / 2, 200))
        points = np.stack([x, 0 * x, z], axis=-1)
        mean = float(exact.parallel_plates_irradiance(points, side, distance, 2.0).mean())
        assert mean == pytest.approx(2 * np.pi * exact.parallel_plates_form_factor(side, distance), rel=1e-4)


@pytest.mark.parametrize("angle", [30.0, 90.0, 140.0])
def test_corner_against_quadrature(angle: float) -> None:
    turn = np.radians(angle)
    for point in ((0.1, 0, 0.4), (-0.3, 0, 0.9)):
        edge = (0, 1.5 * np.sin(turn), 1.5 * np.cos(turn))
        expected = irradiance_by_quadrature(point, (0, 1, 0), (-0.75, 0, 0), (1.5, 0, 0), edge, 1500)
        assert float(exact.corner_irradiance(point, angle, 1.5)) == pytest.approx(expected, rel=1e-3)


def test_corner_tends_to_half_of_all_at_the_contact() -> None:
    """Close to a 90° edge the wall fills half of the cosine-weighted hemisphere: E → π/2."""
    assert float(exact.corner_irradiance((0, 0, 1e-6), 90.0)) == pytest.approx(np.pi / 2, rel=1e-5)


def test_flux_balance_of_concentric_spheres() -> None:
    """Iterating the bounces reaches the sum of the series; energy is conserved: what leaves the lamp is absorbed."""
    inner, outer, albedo, radiance = 0.3, 1.0, 0.7, 2.0
    k = (inner / outer) ** 2
    e = total = np.pi * radiance * k
    for bounce in range(200):
        assert exact.enclosed_sphere_irradiance(inner, outer, albedo, radiance, bounce) == pytest.approx(total)
        e *= albedo * (1 - k)
        total += e
    everything = exact.enclosed_sphere_irradiance(inner, outer, albedo, radiance)
    assert everything == pytest.approx(total)
    emitted = np.pi * radiance * 4 * np.pi * inner**2
    absorbed_by_wall = (1 - albedo) * everything * 4 * np.pi * outer**2
    absorbed_by_lamp = albedo * everything * k * 4 * np.pi * outer**2
    assert emitted == pytest.approx(absorbed_by_wall + absorbed_by_lamp)


def test_integrating_sphere_and_furnace() -> None:
    assert exact.integrating_sphere_irradiance(2.0, 0.5, 3.0, 0) == pytest.approx(0.75)
    assert exact.integrating_sphere_irradiance(2.0, 0.5, 3.0) == pytest.approx(1.5)
    assert exact.furnace_radiance(0.9, 2.0) == pytest.approx(20.0)


def test_spheres_have_exact_area_ratio() -> None:
    """The mean irradiance on the shell is the flux over its area, so the facets' areas must be in the ratio of the true spheres."""
    scene = load_scene("sphere-in-sphere", inner=0.4)
    world = scene.world(0)
    lamp = world.areas[world.emissive].sum()
    assert lamp / (world.areas.sum() - lamp) == pytest.approx(0.16, rel=1e-5)


@pytest.mark.parametrize("shape", ["clutter", "box", "sphere"])
def test_furnace_is_closed(shape: str) -> None:
    """Every ray from the camera's place hits the front of a surface: nothing escapes, no back face shows."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    world = load_scene("furnace", shape=shape).world(0)
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(world.positions[world.triangles]))
    ways = np.random.default_rng(1).normal(size=(4000, 3)).astype(np.float32)
    origins = np.tile(world.camera.pose[:3, 3].astype(np.float32), (4000, 1))
    hit = scene.run(origins, ways)
    assert (hit >= 0).all()
    assert (np.einsum("ri,ri->r", world.face_normals[hit], ways) < 0).all()


def test_parallel_plates_beam_lights_all_of_the_source_and_nothing_of_the_receiver() -> None:
    for side, distance in ((1.0, 1.0), (3.0, 0.2)):
        scene = load_scene("parallel-plates", side=side, distance=distance)
        (light,) = scene.world(0).lights
        corners = np.array([(x, distance, z) for x in (-side / 2, side / 2) for z in (-side / 2, side / 2)])
        crossing = corners - light.direction * distance / light.direction[1]
        assert (crossing[:, 0] < -side / 2).all()
        assert light.direction[1] > 0
        # the source faces down, so its irradiance is intensity · cos
        np.testing.assert_allclose(light.intensity * light.direction[1], np.pi, rtol=1e-6)


def test_corner_beam_lights_both_plates_alike() -> None:
    for angle in (20.0, 90.0, 150.0):
        world = load_scene("corner", angle=angle).world(0)
        (light,) = world.lights
        cosines = -(world.face_normals @ light.direction)
        np.testing.assert_allclose(cosines, np.sin(np.radians(angle / 2)), rtol=1e-5)
