"""Reprojection of hemisphere samples on GL against the CPU's (A15 of temporal radiance caching)."""

import numpy as np
import pytest
from numpy.typing import NDArray

import renderers.gl.reprojection as gl_module
from renderers.gl.reprojection import Reprojected, reprojected
from renderers.transport.caching.plane import plane_directions, plane_weights
from renderers.transport.temporal import plane

pytestmark = pytest.mark.gl
F64 = NDArray[np.float64]


def samples(count: int, speed: float, side: int = 64) -> tuple[F64, F64]:
    """Points (K, side², 3) one frame later and their radiance (K, side², 3): a tilted wall, and before it a disc that moves."""
    rng, away = np.random.default_rng(6), plane_directions(side)
    x, y = (away[:, :2] / away[:, 2:]).T
    points, light = [], []
    for _ in range(count):
        tilt, centre, moves = rng.uniform(-0.2, 0.2, 2), rng.uniform(-1, 1, 2), rng.normal(size=3) * speed
        wall = rng.uniform(2, 3) / (1 + tilt[0] * x + tilt[1] * y)
        disc = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < 0.3
        depth = np.where(disc, 1.2 + 0.1 * x, wall)
        points.append(np.stack([x * depth, y * depth, depth], axis=1) + np.where(disc[:, None], moves, 0))
        light.append(np.where(disc[:, None], 0.2, 1 + np.sin(3 * x)[:, None]) * [1, 0.8, 0.6])
    return np.array(points), np.array(light)


def test_a15_passes_are_those_of_the_cpu() -> None:
    """Ten planes: at most 0.2 % of the pixels differ (float32 where a point lands on a pixel's edge), E₁ by 10⁻⁴."""
    points, light = samples(10, 0.15)
    found, expected = reprojected(points), plane.reprojected(points)
    same = found.source == expected.source
    assert same.mean(axis=(1, 2)).min() >= 0.998
    assert (found.holes == expected.holes).mean(axis=(1, 2)).min() >= 0.998
    np.testing.assert_allclose(found.depth[same], expected.depth[same], rtol=1e-6)
    assert expected.holes.sum() > 10 * 20
    weights = plane_weights().cosine.ravel()
    irradiance = [
        np.einsum("p,kpc->kc", weights, np.take_along_axis(light, drawn.source.reshape(10, -1, 1), axis=1))
        for drawn in (found, expected)
    ]
    np.testing.assert_allclose(irradiance[0], irradiance[1], rtol=1e-4)


def test_a12_what_is_at_rest_stays() -> None:
    points, _ = samples(3, 0.0)
    found = reprojected(points)
    assert not found.holes.any()
    np.testing.assert_array_equal(found.source.reshape(3, -1), np.tile(np.arange(64 * 64), (3, 1)))


def test_collisions_ties_and_points_that_leave() -> None:
    """The nearest wins, of equally near ones the last; behind the plane's eye and beyond its rim nothing is drawn."""
    points = np.array([[(0.1, 0.1, 1), (0.1, 0.1, 0.5), (0.1, 0.1, 0.5), (0, 0, -1), (9, 0, 1), (-0.1, -0.1, 3), (0, 0, 0)]], float)
    found = reprojected(points, 2, 1.0)
    for one, other in zip(found, plane.reprojected(points, 2, 1.0), strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.source[0, 1, 1] == 2


def test_batches_give_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    points, _ = samples(7, 0.2, 16)
    whole = reprojected(points, 16)
    monkeypatch.setattr(gl_module, "BATCH", 2 * 16 * 16)
    for one, other in zip(whole, reprojected(points, 16), strict=True):
        np.testing.assert_array_equal(one, other)


def test_nothing_to_draw() -> None:
    """A plane that no point reaches sees nothing, those beside it what they see; no planes are none."""
    points = np.array([[(0.0, 0.0, -1.0)], [(0.0, 0.0, 1.0)]])
    for one, other in zip(reprojected(points, 4), plane.reprojected(points, 4), strict=True):
        np.testing.assert_array_equal(one, other)
    assert (reprojected(points, 4).source == [[[-1]], [[0]]]).all()
    none: Reprojected = reprojected(np.zeros((0, 4, 3)), 4)
    assert none.source.shape == (0, 4, 4)
