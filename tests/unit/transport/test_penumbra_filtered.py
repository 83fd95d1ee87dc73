"""Peers on scene T1: the floor's errors that the specification gives for a plain map, PCF, PCSS and averaged maps."""

import numpy as np
import pytest
from penumbra_scene import BLOCKERS, FLOOR, average_of_tests, depth_of, floor_points, hidden_share, light_points, view

from renderers.transport.penumbra.cameras import cameras_of
from renderers.transport.penumbra.filtered import averaged, percentage_closer, soft

FLOOR_NORMAL = np.array([0.2, 0.0, -1.0]) / np.hypot(0.2, 1.0)
BIAS = 1e-4


@pytest.mark.parametrize("half", [0.1, 1.0])
def test_errors_of_one_map(half: float) -> None:
    """Specification 8, half side 1: hard .190, PCF over 7² texels .167, PCSS .076; half side .1: PCSS .0121. Within a quarter."""
    where = floor_points(60)
    truth = hidden_share(BLOCKERS, where, 40, half)
    pyramid = view(32)
    cameras = cameras_of(pyramid, np.zeros((1, 3)), 1024)
    maps = depth_of((FLOOR, *BLOCKERS), cameras, 1024)
    normals = np.tile(FLOOR_NORMAL, (len(where), 1))
    extent = np.full(2, half)
    kernels = {"hard": percentage_closer(BIAS, 1), "pcf": percentage_closer(BIAS, 7), "pcss": soft(BIAS, 32)}
    rmse = {
        name: float(np.sqrt(((kernel(pyramid, cameras, maps, where, normals, extent) - truth) ** 2).mean()))
        for name, kernel in kernels.items()
    }
    if half == 1.0:
        assert rmse["hard"] == pytest.approx(0.190, rel=0.25)
        assert rmse["pcf"] == pytest.approx(0.167, rel=0.25)
        assert rmse["pcss"] == pytest.approx(0.076, rel=0.25)
    assert rmse["pcss"] < rmse["pcf"] < rmse["hard"] or half < 1
    if half == 0.1:
        assert rmse["pcss"] <= 0.0121 * 1.25


def test_averaged_maps_are_the_mean_of_tests() -> None:
    """Against numpy, where the receiver's plane faces the axis: then its depth at a texel is the point's own."""
    points = light_points(9)
    pyramid = view(16)
    cameras = cameras_of(pyramid, points, 64)
    maps = depth_of(BLOCKERS, cameras, 64)
    rng = np.random.default_rng(3)
    z = rng.uniform(4, 15, 2000)
    where = np.stack([rng.uniform(-0.49, 0.49, 2000) * z, rng.uniform(-0.49, 0.49, 2000) * z, z], axis=1)
    normals = np.tile([0.0, 0.0, -1.0], (2000, 1))
    ours = averaged(0.02)(pyramid, cameras, maps, where, normals, np.ones(2))
    np.testing.assert_allclose(ours, average_of_tests(cameras, maps, where, 0.02), atol=1e-6)


@pytest.mark.parametrize("taps", [1, 7])
def test_a_plane_does_not_shadow_itself(taps: int) -> None:
    """Receiver-plane bias: with next to no constant bias a tilted floor stays unshadowed under every filter."""
    where = floor_points(40)
    pyramid = view(16)
    cameras = cameras_of(pyramid, np.zeros((1, 3)), 128)
    maps = depth_of((FLOOR,), cameras, 128)
    normals = np.tile(FLOOR_NORMAL, (len(where), 1))
    for kernel in (percentage_closer(BIAS, taps), soft(BIAS, 16)):
        assert kernel(pyramid, cameras, maps, where, normals, np.ones(2)).max() == 0
