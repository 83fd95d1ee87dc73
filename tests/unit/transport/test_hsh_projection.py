"""Projection, hemisphere images, environments and indices of hemispherical harmonics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderers.scene.environment import radiance
from renderers.scene.model import Environment
from renderers.transport.hemispherical import projection
from renderers.transport.hemispherical.basis import (
    degrees,
    directions_of,
    hemispherical_harmonics,
    index,
    order_of,
    spherical_harmonics,
)
from renderers.transport.hemispherical.environment import incoming, project_environment
from renderers.transport.hemispherical.quadrature import hemisphere_quadrature, sphere_quadrature

IMAGES = {"polar": projection.polar_pixels(16, 32), "hemicube": projection.hemicube_pixels(16)}


@given(st.integers(1, 30))
def test_indices_and_orders_fit_together(order: int):
    degree, m = degrees(order)
    assert [index(int(a), int(b)) for a, b in zip(degree, m, strict=True)] == list(range(order**2))
    assert order_of(order**2) == order


@pytest.mark.parametrize("count", [-1, 0, 2, 24])
def test_counts_that_are_no_squares_are_refused(count: int):
    with pytest.raises(ValueError, match=str(count)):
        order_of(count)


def test_bad_orders_indices_and_types_are_refused():
    up = np.array([[0.0, 0, 1]])
    with pytest.raises(ValueError, match="at least 1"):
        hemispherical_harmonics(up, 0)
    with pytest.raises(ValueError, match="float32 or float64"):
        spherical_harmonics(up.astype(np.float16), 2)
    with pytest.raises(ValueError, match="no function"):
        index(2, 3)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_projection_inverts_reconstruction(seed: int, order: int):
    coefficients = np.random.default_rng(seed).standard_normal((order**2, 3))
    quadrature = hemisphere_quadrature(order + 1, 2 * order + 1)
    again = projection.project(projection.reconstruct(coefficients, quadrature.directions), quadrature, order)
    np.testing.assert_allclose(again, coefficients, atol=1e-12)


def test_random_samples_estimate_the_coefficients_within_their_own_error():
    """|estimate - truth| over its standard error is a chi distribution: the mean square over 25 coefficients is 1 ± 4·√(2/25)."""
    rng = np.random.default_rng(5)
    truth = rng.standard_normal(25)
    directions = directions_of(rng.random(40_000), 2 * np.pi * rng.random(40_000))
    values, pdf = projection.reconstruct(truth, directions), np.full(40_000, 1 / (2 * np.pi))
    found = projection.project_samples(values, directions, pdf, 5)
    error = (hemispherical_harmonics(directions, 5) * (values / pdf)[:, None]).std(axis=0) / 200
    assert abs(np.mean(((found - truth) / error) ** 2) - 1) < 4 * np.sqrt(2 / 25)


@pytest.mark.parametrize("name", IMAGES)
def test_pixels_cover_the_hemisphere_and_a_constant_has_one_coefficient(name: str):
    weights = projection.image_weights(IMAGES[name], 6)
    expected = np.zeros(36)
    expected[0] = np.sqrt(2 * np.pi)
    # 3×3 Gauss nodes meet the square root of odd m at the horizon: 1e-3 at 16 pixels a side
    np.testing.assert_allclose(projection.project_image(np.ones(len(weights)), weights), expected, atol=2e-3)
    assert abs(IMAGES[name].weights.sum() - 2 * np.pi) < 1e-6
    up = (IMAGES[name].weights * IMAGES[name].directions[..., 2]).sum()
    assert abs(up - np.pi) < 1e-5


@pytest.mark.parametrize("name", IMAGES)
def test_images_of_a_smooth_function_have_its_coefficients(name: str):
    """Radiance is taken as constant in each pixel: halving the pixels quarters the error."""
    truth = np.zeros(16)
    truth[[0, 2, 3, 6]] = 2.0, 0.5, 0.3, -0.2
    errors = []
    for scale in (1, 2):
        pixels = projection.polar_pixels(16 * scale, 32 * scale) if name == "polar" else projection.hemicube_pixels(16 * scale)
        image = (projection.reconstruct(truth, pixels.directions) * pixels.weights).sum(axis=1) / pixels.weights.sum(axis=1)
        found = projection.project_image(np.stack([image] * 3, axis=1), projection.image_weights(pixels, 4))
        assert found.shape == (16, 3)
        errors.append(np.abs(found[:, 0] - truth).max())
    assert errors[0] < 0.02
    assert errors[1] < 0.4 * errors[0]


def test_the_plane_image_lies_as_documented():
    pixels = projection.plane_pixels(4, 2.0)
    first = pixels.directions[0].mean(axis=0)
    assert first[0] < 0 < first[1]
    # a square of half width h at distance 1 subtends 4 arcsin(h²/(1 + h²))
    assert abs(projection.plane_pixels(32, 2.0).weights.sum() - 4 * np.arcsin(4 / 5)) < 1e-6


def test_hemicube_sides_have_row_0_on_top_and_look_their_way():
    size = 8
    directions = projection.hemicube_pixels(size).directions.mean(axis=1)
    sides = directions[size * size :].reshape(4, size // 2, size, 3)
    for side, axis in zip(sides, [(1, 0), (0, 1), (-1, 0), (0, -1)], strict=True):
        assert (side[..., :2] @ np.array(axis) > 0.5).all()
        assert side[0, 0, 2] > side[-1, 0, 2] > 0
        right = side[0, -1] - side[0, 0]
        assert np.dot(np.cross([axis[0], axis[1], 0], [0, 0, 1]), right) > 0
    with pytest.raises(ValueError, match="even"):
        projection.hemicube_pixels(5)


def test_irradiance_needs_order_2():
    with pytest.raises(ValueError, match="order 2"):
        projection.irradiance(np.ones(1))


def image_environment() -> Environment:
    rng = np.random.default_rng(11)
    return Environment(image=rng.random((12, 20, 3), dtype=np.float32), radiance=(1.0, 0.5, 2.0), rotation=(0.5, 0.5, -0.5, 0.5))


def test_an_environment_image_is_integrated_cell_by_cell():
    """Against a fine rule that knows nothing of cells; its own error on the kinks of the bilinear image is below 1e-3."""
    environment = image_environment()
    quadrature = sphere_quadrature(300, 600)
    values = radiance(environment, quadrature.directions) * quadrature.weights[:, None]
    np.testing.assert_allclose(
        project_environment(environment, 6), spherical_harmonics(quadrature.directions, 6).T @ values, atol=4e-3
    )


def test_a_bright_texel_lies_where_the_environment_has_it():
    image = np.zeros((16, 32, 3), np.float32)
    image[5, 9] = 1
    environment = Environment(image=image)
    coefficients = project_environment(environment, 2)[:, 0]
    towards = -coefficients[[3, 1, 2]] * [1, 1, -1]  # Condon–Shortley: the functions of degree 1 are -y, z, -x
    directions = directions_of(np.linspace(-1, 1, 200)[:, None], np.linspace(0, 2 * np.pi, 400)).reshape(-1, 3)
    brightest = directions[radiance(environment, directions)[:, 0].argmax()]
    assert towards @ brightest / np.linalg.norm(towards) > 0.999


def test_a_constant_environment_above_any_frame():
    spherical = project_environment(Environment(radiance=(1.0, 2.0, 3.0)), 8)
    above = incoming(spherical, np.stack([np.eye(3), [[0, 1, 0], [0, 0, 1], [1, 0, 0]]]), 4)
    np.testing.assert_allclose(above[:, 0], np.sqrt(2 * np.pi) * np.array([[1, 2, 3]] * 2), atol=1e-12)
    np.testing.assert_allclose(projection.irradiance(above[0]), np.pi * np.array([1, 2, 3]), atol=1e-12)
