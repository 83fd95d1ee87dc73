"""The occlusion-aware Hessian of irradiance, the radius made of it, and the smallest reach in pixels."""

import numpy as np
import pytest

from renderers.transport.caching.gradients import Moments, polar_moments
from renderers.transport.caching.limits import Footprint, Limits, hessian_radius, limited
from renderers.transport.caching.records import Records


def half_plane(rings: int, sectors: int, height: float, offset: float, fine: int = 8) -> Moments:
    """Under a plane `height` above that sends radiance 1 where x > offset; every cell the mean of fine × fine directions."""
    square = (np.arange(rings * fine) + 0.5) / (rings * fine)
    phi = 2 * np.pi * (np.arange(sectors * fine) + 0.5) / (sectors * fine)
    distance = height / np.sqrt(1 - square)[:, None] * np.ones(sectors * fine)
    bright = (distance * np.sqrt(square)[:, None] * np.cos(phi) > offset).astype(float)
    light, near = (a.reshape(rings, fine, sectors, fine).mean(axis=(1, 3)) for a in (bright, 1 / distance))
    return polar_moments(np.repeat(light[None, ..., None], 3, axis=-1), near[None])


@pytest.mark.parametrize(("height", "offset"), [(0.5, 0.3), (0.5, -0.1), (1.0, 0.7)])
def test_irradiance_gradient_and_hessian_of_a_half_plane(height: float, offset: float) -> None:
    """E = π/2 (1 - u/√(u² + h²)), u the offset from the observer: E' = π/2 h² (u² + h²)^-3/2, E'' = 3π/2 h² u (u² + h²)^-5/2 along
    x, nothing along y. Cells of a finite height blur the edge: errors fall as 1/M."""
    square = offset**2 + height**2
    expected = 1.5 * np.pi * height**2 * offset * square**-2.5
    errors = []
    for rings, sectors in ((16, 50), (64, 200)):
        found = half_plane(rings, sectors, height, offset)
        assert found.irradiance[0, 0] == pytest.approx(np.pi / 2 * (1 - offset / np.sqrt(square)), rel=2e-3)
        assert found.translation[0, 0, 0] == pytest.approx(np.pi / 2 * height**2 * square**-1.5, rel=0.02)
        xx, xy, yy = found.hessian[0]
        assert abs(xy) < 1e-9
        errors.append(max(abs(xx - expected), abs(yy)) / abs(expected))
        assert found.curvature[0] * found.irradiance[0, 0] == pytest.approx(abs(xx), rel=1e-6)
    assert errors[0] < 0.05
    assert errors[1] < 0.4 * errors[0]


def test_the_hessian_turns_with_the_scene() -> None:
    """Whole sectors: a quarter of a circle makes xx and yy change places, an eighth makes them equal, xy half their difference."""
    found = half_plane(16, 48, 0.5, 0.3)
    square = (np.arange(16 * 8) + 0.5) / (16 * 8)
    phi = 2 * np.pi * (np.arange(48 * 8) + 0.5) / (48 * 8)
    distance = 0.5 / np.sqrt(1 - square)[:, None] * np.ones(48 * 8)
    for angle, expected in ((np.pi / 2, found.hessian[0, ::-1]), (np.pi / 4, None)):
        bright = (distance * np.sqrt(square)[:, None] * np.cos(phi - angle) > 0.3).astype(float)
        light, near = (a.reshape(16, 8, 48, 8).mean(axis=(1, 3)) for a in (bright, 1 / distance))
        turned = polar_moments(np.repeat(light[None, ..., None], 3, axis=-1), near[None])
        if expected is not None:
            np.testing.assert_allclose(turned.hessian[0], expected, atol=1e-9)
        else:
            assert turned.hessian[0, 0] == pytest.approx(turned.hessian[0, 2], rel=1e-9)
            difference = found.hessian[0, 0] - found.hessian[0, 2]
            assert turned.hessian[0, 1] == pytest.approx(difference / 2, rel=1e-9)
        np.testing.assert_allclose(turned.curvature, found.curvature, rtol=1e-9)


def records(curvature: float, position: tuple[float, float, float] = (0, 0, 0), slope: float = 0.0) -> Records:
    three = np.zeros((1, 3))
    gradient = np.full((1, 3, 3), slope)
    up = np.array([[0.0, 0, 1]])
    return Records(
        np.array([position], float), up, np.ones(1), three + 1, gradient, np.zeros((1, 3, 3)), curvature=np.array([curvature])
    )


def test_radius_gives_every_zone_the_same_integrated_error() -> None:
    """∫ ½ λ r² over a disc of radius aR is π λ (aR)⁴ / 4 = a⁴ E."""
    for curvature in (0.1, 3.0, 200.0):
        radius = hessian_radius(records(curvature))[0]
        assert np.pi * curvature * (0.15 * radius) ** 4 / 4 == pytest.approx(0.15**4)
    assert np.isinf(hessian_radius(records(0.0))[0])
    with pytest.raises(ValueError, match="no curvature"):
        hessian_radius(Records.empty())


def test_reach_is_at_least_so_many_pixels() -> None:
    """R_min grows with the distance from the eye, between the constant one and R_max; gradients of enlarged records shrink."""
    limits = Limits(0.1, 1.0, gradient=False, footprint=Footprint(np.zeros(3), 0.2), metric="hessian")
    there = np.array([[0.1, 0, 0], [2.0, 0, 0], [0, 50.0, 0]])
    np.testing.assert_allclose(limits.lower(there), [0.1, 0.4, 1.0])
    near = limited(records(1e4, (2.0, 0, 0), slope=1.0), limits)
    unlimited = hessian_radius(records(1e4))[0]
    assert near.radius[0] == pytest.approx(0.4)
    np.testing.assert_allclose(near.translation, unlimited / 0.4)
