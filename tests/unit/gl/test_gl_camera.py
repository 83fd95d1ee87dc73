"""Projections (no GL needed): a pixel's ray lands on its centre, and stored depth is near over distance in either convention."""

from __future__ import annotations

import numpy as np
import pytest

from renderers.gl import camera
from renderers.scene.load import load_scene

SIZE = (16, 9)


def window_depth(clip: np.ndarray, zero_to_one: bool) -> np.ndarray:
    z = clip[..., 2] / clip[..., 3]
    return z if zero_to_one else (z + 1) / 2


@pytest.mark.parametrize("zero_to_one", [True, False])
@pytest.mark.parametrize("offset", [(0.5, 0.5), (0.1, 0.9)])
def test_points_on_a_pixels_ray_land_on_its_centre(zero_to_one, offset):
    world = load_scene("cornell-box").world()
    origins, directions = world.camera.rays(SIZE, offset)
    distance = np.random.default_rng(0).uniform(0.5, 3, directions.shape[:2])[..., None]
    points = np.concatenate([origins + directions * distance, np.ones_like(distance)], axis=-1)
    clip = points @ camera.world_to_clip(world, SIZE, offset, zero_to_one=zero_to_one).T
    pixel = (clip[..., :2] / clip[..., 3:] * 0.5 + 0.5) * SIZE
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    assert np.allclose(pixel, np.stack([columns, rows], axis=-1) + 0.5, atol=1e-9)
    along = (points[..., :3] - origins) @ -world.camera.pose[:3, 2]
    assert np.allclose(window_depth(clip, zero_to_one), world.clip[0] / along, rtol=1e-9)


@pytest.mark.parametrize("zero_to_one", [True, False])
def test_parallel_depth_falls_from_1_to_0(zero_to_one):
    matrix = camera.orthographic(np.array([1.0, 2.0]), np.array([2.0, 4.0]), (-1.0, 3.0), zero_to_one=zero_to_one)
    clip = np.array([[1.0, 2.0, 1.0, 1.0], [3.0, -2.0, -3.0, 1.0]]) @ matrix.T
    assert np.allclose(clip[:, :2], [[0, 0], [1, -1]])
    assert np.allclose(window_depth(clip, zero_to_one), [1, 0])
