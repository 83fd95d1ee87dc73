"""Shapes, batches and bytes of rotations of hemispherical harmonics; Euler angles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from renderers.transport.hemispherical.conversion import conversion_matrix, to_hemispherical, to_spherical
from renderers.transport.hemispherical.lune import about_y, lune_table, rotation_matrix_y
from renderers.transport.hemispherical.rotation import euler_angles, rotate
from renderers.transport.hemispherical.sphere_rotation import rotate_spherical

ANGLE = st.floats(-np.pi, np.pi)
METHODS = ["precomputed", "spherical", "analytic"]


@settings(deadline=None)
@given(ANGLE, st.one_of(st.floats(0, np.pi), st.sampled_from([0.0, 1e-9, 1e-8, np.pi])), ANGLE)
def test_euler_angles_make_the_rotation_again(alpha: float, beta: float, gamma: float):
    rotation = Rotation.from_euler("ZYZ", [alpha, beta, gamma]).as_matrix()
    found = np.stack(euler_angles(rotation[None]), axis=1)
    again = Rotation.from_euler("ZYZ", found).as_matrix()[0]
    np.testing.assert_allclose(again, rotation, atol=2e-7)  # the tilt under 1e-7 is dropped


@pytest.mark.parametrize("method", METHODS)
def test_channels_and_items_are_rotated_alike(method):
    rng = np.random.default_rng(3)
    rotations = Rotation.from_euler("ZYZ", rng.uniform([-3, 0, -3], [3, 1.5, 3], (7, 3))).as_matrix()
    rotations[2] = np.eye(3)
    coefficients = rng.standard_normal((7, 16, 3))
    together = rotate(coefficients, rotations, method, angles=9)
    assert together.shape == coefficients.shape
    for k in range(7):
        for c in range(3):
            np.testing.assert_array_equal(
                rotate(coefficients[k : k + 1, :, c], rotations[k], method, angles=9)[0], together[k, :, c]
            )
    np.testing.assert_array_equal(together[2], coefficients[2])


@pytest.mark.parametrize("method", METHODS)
def test_no_items_are_no_error(method):
    assert rotate(np.zeros((0, 16, 3)), np.zeros((0, 3, 3)), method, angles=9).shape == (0, 16, 3)


def test_the_input_is_left_alone():
    coefficients = np.ones((2, 16))
    rotate(coefficients, about_y(0.5), angles=9)
    assert (coefficients == 1).all()


def test_tilts_beyond_the_table_are_integrated():
    coefficients = np.random.default_rng(2).standard_normal((1, 16))
    turned = rotate(coefficients, about_y(2.0), angles=9)
    np.testing.assert_allclose(turned, coefficients @ rotation_matrix_y(2.0, 4), atol=1e-12)


def test_the_table_is_exact_at_its_angles():
    table = lune_table("rotation", 4, 9)
    for k in (0, 3, 8):
        beta = np.pi / 2 * (k / 8) ** 1.5
        assert np.abs(table.matrix(beta) - rotation_matrix_y(beta, 4)).max() < 1e-6  # float32
    with pytest.raises(ValueError, match="at least 2"):
        lune_table("rotation", 4, 1)


def test_rotations_of_the_sphere_compose():
    first, second = Rotation.random(2, random_state=4).as_matrix()
    coefficients = np.random.default_rng(1).standard_normal((1, 144))
    np.testing.assert_allclose(
        rotate_spherical(rotate_spherical(coefficients, first), second), rotate_spherical(coefficients, second @ first), atol=1e-12
    )


def test_sparse_and_dense_conversion_agree():
    rng = np.random.default_rng(1)
    upper, whole = rng.standard_normal((3, 2, 25)), rng.standard_normal(100)
    np.testing.assert_allclose(to_spherical(upper, 10), upper @ conversion_matrix(5, 10), atol=1e-13)
    np.testing.assert_allclose(to_hemispherical(whole, 5), conversion_matrix(5, 10) @ whole, atol=1e-13)
