"""Hemispherical harmonics against closed forms, an independent library and published figures: checks A1 to A22, then hard cases.

The oracle for values is scipy's complex `sph_harm_y` (Condon–Shortley sign included), through H(μ, φ) = √2 Y(2μ - 1, φ).
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from renderers.transport.hemispherical import projection
from renderers.transport.hemispherical.basis import (
    degrees,
    directions_of,
    hemispherical_harmonics,
    index,
    spherical_harmonics,
)
from renderers.transport.hemispherical.brdf_table import BrdfTable, brdf_coefficients, brdf_table, paraboloid, paraboloid_direction
from renderers.transport.hemispherical.comparison import BASES, captured
from renderers.transport.hemispherical.conversion import conversion_matrix, to_hemispherical
from renderers.transport.hemispherical.lune import about_y, deletion_matrix, lune_table, rotation_matrix_y
from renderers.transport.hemispherical.models import of_material, order_for, phong, ward
from renderers.transport.hemispherical.quadrature import (
    Quadrature,
    gauss_legendre,
    hemisphere_quadrature,
    lune_quadrature,
    sphere_quadrature,
)
from renderers.transport.hemispherical.rotation import rotate, rotate_about_z, spherical_angle
from renderers.transport.hemispherical.sphere_rotation import rotate_spherical, spherical_rotation_matrix

FINE = hemisphere_quadrature(200, 400)
PLAIN = hemisphere_quadrature(96, 192)
ORDERS = (2, 3, 4, 5, 7, 10)


def tilted(degrees_off: float) -> np.ndarray:
    angle = np.radians(degrees_off)
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def random_upper(count: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return directions_of(rng.random(count), 2 * np.pi * rng.random(count))


def norm2(matrix: np.ndarray) -> float:
    return float(np.linalg.norm(matrix, 2))


@pytest.mark.parametrize("order", [9, 11, 21, 30])
def test_a1_hemispherical_harmonics_are_orthonormal(order: int):
    quadrature = hemisphere_quadrature(order + 8, 2 * order + 1)
    values = hemispherical_harmonics(quadrature.directions, order)
    gram = (values * quadrature.weights[:, None]).T @ values
    assert np.abs(gram - np.eye(order**2)).max() < 1e-12


@pytest.mark.parametrize("order", [10, 21])
def test_a1_values_equal_those_of_an_independent_library(order: int):
    rng = np.random.default_rng(3)
    mu, phi = rng.random(500), 2 * np.pi * rng.random(500)
    upper, whole = hemispherical_harmonics(directions_of(mu, phi), order), spherical_harmonics(directions_of(mu, phi), order)
    for degree in range(order):
        for m in range(degree + 1):
            for values, x, scale in ((upper, 2 * mu - 1, np.sqrt(2)), (whole, mu, 1.0)):
                oracle = scale * sph_harm_y(degree, m, np.arccos(x), phi) * (np.sqrt(2) if m else 1)
                # arccos loses digits near x = ±1; degree 20 amplifies 1e-16 by l²
                np.testing.assert_allclose(values[:, index(degree, m)], oracle.real, atol=1e-12)
                if m:
                    np.testing.assert_allclose(values[:, index(degree, -m)], oracle.imag, atol=1e-12)


def test_a2_addition_theorem():
    order = 11
    squares = hemispherical_harmonics(random_upper(1000), order) ** 2
    for degree in range(order):
        band = squares[:, degree**2 : (degree + 1) ** 2].sum(axis=1)
        assert np.abs(band - (2 * degree + 1) / (2 * np.pi)).max() < 1e-12


def test_a3_cosine_has_two_coefficients_and_a_constant_one():
    quadrature = hemisphere_quadrature(20, 40)
    cosine = np.zeros(100)
    cosine[[index(0, 0), index(1, 0)]] = np.sqrt(np.pi / 2), np.sqrt(np.pi / 6)
    np.testing.assert_allclose(projection.project(quadrature.directions[:, 2], quadrature, 10), cosine, atol=1e-10)
    constant = np.zeros(100)
    constant[0] = np.sqrt(2 * np.pi)
    np.testing.assert_allclose(projection.project(np.ones(len(quadrature.weights)), quadrature, 10), constant, atol=1e-10)


TABLE = np.zeros((9, 9))
for _row, _column, _value in [
    (0, 0, 0.7071), (0, 2, 0.6124), (1, 1, 0.6739), (1, 5, 0.6745), (2, 2, 0.3536), (2, 6, 0.6847), (3, 3, 0.6739), (3, 7, 0.6745),
    (4, 4, 0.6187), (5, 1, -0.1578), (5, 5, 0.2117), (6, 6, 0.1768), (7, 3, -0.1578), (7, 7, 0.2117), (8, 8, 0.6187),
]:  # fmt: skip
    TABLE[_row, _column] = _value


def test_a4_conversion_matrix_of_order_3():
    matrix = conversion_matrix(3, 3)
    assert np.abs(matrix - TABLE).max() < 5e-5 + 1e-12  # the table has four decimals
    exact = [matrix[0, 0], matrix[0, 2], matrix[2, 2], matrix[2, 0]]
    np.testing.assert_allclose(exact, [1 / np.sqrt(2), np.sqrt(3 / 8), 1 / np.sqrt(8), 0], atol=1e-13)


def test_a4_conversion_matrix_equals_its_definition():
    """For even m the integrand is a polynomial and plain nodes are exact; odd m converge slowly and are covered by the table."""
    quadrature = hemisphere_quadrature(40, 41)
    upper, whole = hemispherical_harmonics(quadrature.directions, 8), spherical_harmonics(quadrature.directions, 20)
    even = degrees(8)[1] % 2 == 0
    direct = (upper * quadrature.weights[:, None]).T @ whole
    assert np.abs(conversion_matrix(8, 20) - direct)[even].max() < 1e-12
    assert np.abs(conversion_matrix(8, 20) - direct).max() < 1e-4


def test_a5_the_printed_matrix_is_another_one():
    """The thesis prints a table that is the transposed matrix of 2 cos θ-weighted products (largest entries below)."""
    quadrature = hemisphere_quadrature(60, 61)
    upper, whole = hemispherical_harmonics(quadrature.directions, 3), spherical_harmonics(quadrature.directions, 3)
    weighted = (whole * (2 * quadrature.directions[:, 2] * quadrature.weights)[:, None]).T @ upper
    printed = np.sort([0.71, 0.41, 0.82, 0.60, 0.19, 0.77, 0.53, 0.51, 0.40, 0.78, 0.18])
    ours = np.unique(np.round(np.abs(weighted[np.abs(weighted) > 0.01]), 6))
    assert np.abs(printed[:, None] - ours).min(axis=1).max() < 0.005
    assert np.abs(weighted - conversion_matrix(3, 3)).max() > 0.3
    assert np.abs(weighted - conversion_matrix(3, 3).T).max() > 0.3


def test_a6_conversion_never_mixes_azimuths():
    matrix = conversion_matrix(10, 30)
    assert np.abs(matrix[degrees(10)[1][:, None] != degrees(30)[1]]).max() < 1e-12
    assert (np.abs(conversion_matrix(10, 10)) > 1e-10).sum() == 597


def test_a7_the_way_there_and_back_loses_less_with_more_spherical_harmonics():
    losses = [np.linalg.norm(m @ m.T - np.eye(100)) / 10 for m in (conversion_matrix(10, k * 10) for k in (1, 2, 3, 4))]
    np.testing.assert_allclose(losses, [0.702, 0.212, 0.121, 0.087], atol=1e-3)
    assert losses[2] < 0.13


def test_a8_spherical_rotation_equals_quadrature_and_is_orthogonal():
    order = 11
    quadrature = sphere_quadrature(order + 1, 2 * order + 1)
    values = spherical_harmonics(quadrature.directions, order)
    for rotation in Rotation.random(4, random_state=5).as_matrix():
        matrix = spherical_rotation_matrix(rotation, order)
        direct = (values * quadrature.weights[:, None]).T @ spherical_harmonics(quadrature.directions @ rotation, order)
        assert np.abs(matrix - direct).max() < 1e-12
        assert np.abs(matrix @ matrix.T - np.eye(order**2)).max() < 1e-12


def test_a9_rotation_about_z_is_exact():
    rng = np.random.default_rng(2)
    coefficients, angle = rng.standard_normal(100), 0.7
    quadrature = hemisphere_quadrature(20, 41)
    turn = Rotation.from_euler("z", angle).as_matrix()
    direct = projection.project(projection.reconstruct(coefficients, quadrature.directions @ turn), quadrature, 10)
    np.testing.assert_allclose(rotate_about_z(coefficients[None], angle)[0], direct, atol=1e-10)


@pytest.mark.parametrize("order", [5, 10])
def test_a10_the_lune_matrix(order: int):
    assert np.abs(rotation_matrix_y(0.0, order) - np.eye(order**2)).max() < 1e-9
    matrix = rotation_matrix_y(0.6, order)
    assert np.abs(rotation_matrix_y(-0.6, order) - matrix.T).max() < 1e-9
    assert norm2(matrix) < 1 + 1e-9
    quadrature = lune_quadrature(0.6, np.pi, 64)  # as measured, without the symmetry that the function imposes
    turned = hemispherical_harmonics(quadrature.directions @ about_y(0.6).T, order)
    raw = (hemispherical_harmonics(quadrature.directions, order) * quadrature.weights[:, None]).T @ turned
    cosine = degrees(order)[1] >= 0
    assert np.abs(raw[cosine[:, None] != cosine]).max() < 1e-9


def test_a10_the_deletion_matrix():
    matrix = deletion_matrix(0.6, 10)
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert np.abs(matrix - matrix.T).max() < 1e-12
    assert eigenvalues.min() > -1e-9
    assert eigenvalues.max() < 1 + 1e-9
    assert abs(norm2(matrix @ matrix - matrix) - 0.25) < 0.01  # no projector


def test_a11_the_way_over_the_sphere_converges_to_the_exact_projection():
    coefficients = brdf_coefficients(phong(20), tilted(30)[None], 10, cosine=False, quadrature=PLAIN)[..., 0]
    for beta in np.radians([5, 20, 40, 60]):
        exact = coefficients @ rotation_matrix_y(float(beta), 10)
        errors = [
            np.linalg.norm(rotate(coefficients, about_y(beta), "spherical", sphere_order=n) - exact) / np.linalg.norm(coefficients)
            for n in (10, 20, 30)
        ]
        assert errors[2] < 0.01
        assert errors[2] < errors[1] < errors[0]


# Relative L² error by tilt: exact, spherical with N = n, with N = 2n, analytic with deletion, spherical matrix with β itself.
ROTATIONS = {
    (10, 20, 0): {
        10: (0.003, 0.076, 0.004, 0.010, 0.169),
        30: (0.005, 0.076, 0.005, 0.049, 0.503),
        45: (0.009, 0.074, 0.009, 0.110, 0.745),
        60: (0.034, 0.075, 0.034, 0.232, 0.972),
        80: (0.238, 0.243, 0.238, 0.597, 1.25),
    },
    (10, 20, 30): {
        10: (0.005, 0.075, 0.005, 0.051, 0.191),
        30: (0.034, 0.075, 0.034, 0.243, 0.601),
        45: (0.170, 0.178, 0.170, 0.579, 0.911),
        80: (0.556, 0.647, 0.556, 0.97, 8.7),
    },
    (5, 5, 0): {
        10: (0.003, 0.074, 0.003, 0.020, 0.096),
        30: (0.009, 0.073, 0.009, 0.079, 0.295),
        45: (0.040, 0.081, 0.040, 0.176, 0.450),
        60: (0.108, 0.126, 0.108, 0.323, 0.603),
        80: (0.227, 0.234, 0.227, 0.460, 0.817),
    },
}


def turned_error(coefficients: np.ndarray, exponent: int, axis: np.ndarray, beta: float) -> float:
    """Relative L² error against the lobe turned about y by β, which is 0 in the lune that has nothing above the old horizon."""
    kept, empty = lune_quadrature(0, np.pi - beta, 96), lune_quadrature(np.pi - beta, np.pi, 96)
    truth = np.maximum(0, kept.directions @ about_y(beta) @ axis) ** exponent
    wrong = (projection.reconstruct(coefficients, kept.directions) - truth) ** 2 @ kept.weights
    wrong += projection.reconstruct(coefficients, empty.directions) ** 2 @ empty.weights
    return float(np.sqrt(wrong / (truth**2 @ kept.weights)))


@pytest.mark.parametrize("case", ROTATIONS)
def test_a12_rotation_errors(case: tuple[int, int, int]):
    order, exponent, start = case
    axis = tilted(start)
    lobe = np.maximum(0, PLAIN.directions @ axis) ** exponent
    coefficients = projection.project(lobe, PLAIN, order)[None]
    for tilt, published in ROTATIONS[case].items():
        beta = float(np.radians(tilt))
        results = (
            coefficients @ rotation_matrix_y(beta, order),
            rotate(coefficients, about_y(beta), "spherical", sphere_order=order),
            rotate(coefficients, about_y(beta), "spherical", sphere_order=2 * order),
            rotate(coefficients, about_y(beta), "analytic"),
            rotate_spherical(coefficients, about_y(beta)),
        )
        errors = np.array([turned_error(result[0], exponent, axis, beta) for result in results])
        assert (np.abs(errors - published) <= np.maximum(0.1 * np.array(published), 0.005)).all(), (tilt, errors)
        table = rotate(coefficients, about_y(beta))
        assert abs(turned_error(table[0], exponent, axis, beta) - errors[0]) < 0.002


def test_a13_angle_of_the_analytic_rotation():
    angles = np.degrees(spherical_angle(np.radians([5.0, 30.0, 60.0, 90.0])))
    np.testing.assert_allclose(angles, [7.0733, 42.9414, 90, 180], atol=1e-3)


PHONG_5 = {
    0: ([0.7732, 0.9681, 0.9984, 1, 1, 1], [0.4895, 0.7879, 0.9431, 0.9914, 1, 1],
        [0.3056, 0.9023, 0.9990, 1, 1, 1], [0.3056, 0.7732, 0.9681, 0.9984, 1, 1]),
    30: ([0.7686, 0.9653, 0.9980, 0.9999, 1, 1], [0.4879, 0.7869, 0.9431, 0.9916, 1, 1],
         [0.4703, 0.9544, 0.9922, 0.9995, 1, 1], [0.4414, 0.8840, 0.9364, 0.9868, 0.9999, 1]),
    45: ([0.7487, 0.9539, 0.9941, 0.9984, 0.9993, 0.9997], [0.4727, 0.7724, 0.9357, 0.9889, 0.9982, 0.9987],
         [0.6044, 0.8922, 0.9879, 0.9987, 0.9997, 0.9999], [0.5673, 0.8758, 0.9647, 0.9887, 0.9999, 1]),
    60: ([0.6885, 0.9152, 0.9752, 0.9883, 0.9948, 0.9976], [0.4236, 0.7126, 0.8895, 0.9609, 0.9839, 0.9890],
         [0.6578, 0.8671, 0.9725, 0.9943, 0.9989, 0.9997], [0.6356, 0.8508, 0.9731, 0.9943, 0.9999, 1]),
    75: ([0.5862, 0.8364, 0.9302, 0.9613, 0.9819, 0.9915], [0.3452, 0.6022, 0.7844, 0.8806, 0.9394, 0.9602],
         [0.6007, 0.8799, 0.9868, 0.9953, 0.9991, 0.9998], [0.6035, 0.8587, 0.9736, 0.9950, 1, 1]),
}  # fmt: skip
WARD = {
    0: ([0.6645, 0.8809, 0.9482, 0.9879, 0.9965, 0.9974], [0.4715, 0.7091, 0.8532, 0.9329, 0.9885, 0.9975],
        [0.3261, 0.8012, 0.9606, 0.9667, 0.9981, 0.9985], [0.3261, 0.7020, 0.8949, 0.9200, 0.9929, 0.9987]),
    30: ([0.6934, 0.8711, 0.9492, 0.9855, 0.9930, 0.9957], [0.4413, 0.6985, 0.8497, 0.9301, 0.9868, 0.9958],
         [0.4847, 0.8589, 0.9533, 0.9657, 0.9961, 0.9974], [0.4503, 0.8093, 0.8555, 0.9359, 0.9912, 0.9978]),
    45: ([0.6399, 0.8813, 0.9528, 0.9688, 0.9835, 0.9874], [0.3841, 0.6577, 0.8384, 0.9252, 0.9762, 0.9860],
         [0.5571, 0.7638, 0.9117, 0.9753, 0.9895, 0.9909], [0.5240, 0.7574, 0.8968, 0.9376, 0.9872, 0.9927]),
    60: ([0.3995, 0.6208, 0.7475, 0.8102, 0.8500, 0.8691], [0.2352, 0.4458, 0.6327, 0.7599, 0.8520, 0.8605],
         [0.4087, 0.6452, 0.8387, 0.8813, 0.9022, 0.9054], [0.4072, 0.6233, 0.8162, 0.8638, 0.9048, 0.9258]),
}  # fmt: skip


@pytest.mark.parametrize("angle", PHONG_5)
def test_a14_accuracy_of_phong(angle: int):
    values = phong(5)(FINE.directions, tilted(angle))
    for basis, published in zip(BASES, PHONG_5[angle], strict=True):
        np.testing.assert_allclose([captured(basis, values, FINE, n * n) for n in ORDERS], published, atol=0.002)


@pytest.mark.parametrize("angle", WARD)
def test_a14_accuracy_of_ward(angle: int):
    values = ward(0.2, 0.5)(FINE.directions, tilted(angle))
    for basis, published in zip(BASES, WARD[angle], strict=True):
        np.testing.assert_allclose([captured(basis, values, FINE, n * n) for n in ORDERS], published, atol=0.002)


@pytest.mark.parametrize(
    ("model", "angle", "upper", "whole"),
    [
        (ward(0.2, 0.5), 45, [0.5644, 0.8453, 0.9586, 0.9875, 0.9991, 0.9999], [0.3238, 0.5834, 0.7854, 0.9049, 0.9861, 0.9997]),
        (phong(20), 30, [0.3087, 0.5647, 0.7726, 0.9016, 0.9897, 0.9999], [0.1651, 0.3342, 0.5156, 0.6790, 0.8942, 0.9907]),
        (phong(15), 30, [0.3813, 0.6613, 0.8550, 0.9517, 0.9976, 1.0], [0.2078, 0.4089, 0.6088, 0.7712, 0.9469, 0.9980]),
    ],
)
def test_a14_accuracy_of_cosine_weighted_lobes(model, angle, upper, whole):
    values = model(FINE.directions, tilted(angle)) * FINE.directions[:, 2]
    for basis, published in (("hemispherical", upper), ("spherical", whole)):
        np.testing.assert_allclose([captured(basis, values, FINE, n * n) for n in ORDERS], published, atol=0.002)


@cache
def room() -> np.ndarray:
    """Incoming radiance (80, Q) at points of a box room, albedo 0.7, lit by a point: all of it reflected once, no occlusion."""
    quadrature, light, rng = hemisphere_quadrature(48, 96), np.array([0.3, -0.2, 0.5]), np.random.default_rng(7)
    incoming = []
    for _ in range(80):
        axis, sign = rng.integers(3), rng.choice([-1, 1])
        point = rng.uniform(-0.9, 0.9, 3)
        point[axis] = sign
        frame = np.roll(np.eye(3), axis + 1, axis=1)  # row 2 is the axis
        frame = np.stack([frame[0], -sign * frame[1], -sign * frame[2]])
        directions = quadrature.directions @ frame
        distance = np.where(directions > 0, 1 - point, -1 - point) / np.where(directions == 0, 1e-300, directions)
        wall = distance.argmin(axis=1)
        hit = point + distance.min(axis=1)[:, None] * directions
        to_light = light - hit
        rows = np.arange(len(hit))
        cosine = np.abs(to_light[rows, wall]) / np.linalg.norm(to_light, axis=1)
        incoming.append(0.7 / np.pi * cosine / (to_light**2).sum(axis=1))
    return np.stack(incoming)


def lighting_error(exponent: float, order: int, basis: Callable[[np.ndarray, int], np.ndarray]) -> float:
    """Root mean square error of reflected radiance over its mean, at 80 points of the room from 6 views."""
    quadrature = hemisphere_quadrature(48, 96)
    views = paraboloid_direction(np.stack([0.5 + 0.07 * np.arange(6), 0.5 + 0.1 * (np.arange(6) % 3)], axis=1))
    lobes = np.stack([phong(exponent)(quadrature.directions, view) for view in views]) * quadrature.directions[:, 2]
    truth = room() @ (lobes * quadrature.weights).T
    values = basis(quadrature.directions, order) * quadrature.weights[:, None]
    found = (room() @ values) @ (lobes @ values).T
    return float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean())


@pytest.mark.parametrize("exponent", [5, 15, 20])
def test_a15_lighting_products_err_less_than_half_of_spherical_harmonics(exponent: int):
    for order in (5, 7, 8, 10):
        assert lighting_error(exponent, order, hemispherical_harmonics) < 0.5 * lighting_error(exponent, order, spherical_harmonics)


def test_a16_irradiance_from_two_coefficients():
    quadrature = hemisphere_quadrature(20, 40)
    coefficients = np.random.default_rng(4).standard_normal((100, 3))
    radiance = projection.reconstruct(coefficients, quadrature.directions)
    direct = (radiance * (quadrature.weights * quadrature.directions[:, 2])[:, None]).sum(axis=0)
    np.testing.assert_allclose(projection.irradiance(coefficients), direct, atol=1e-10)


def test_a17_environment_product_is_that_of_the_truncated_functions():
    rng = np.random.default_rng(6)
    order, sphere_order = 10, 10
    spherical, frame = rng.standard_normal(sphere_order**2), Rotation.random(random_state=8).as_matrix()
    incoming = to_hemispherical(rotate_spherical(spherical[None], frame)[0], order)
    brdf = brdf_coefficients(phong(5), tilted(40)[None], order)[0, :, 0]
    t, weights = gauss_legendre(80, 0, 1)  # μ = t² as the product of both bases has √μ in it
    phi = 2 * np.pi * (np.arange(64) + 0.5) / 64
    directions = directions_of((t * t)[:, None], phi).reshape(-1, 3)
    lit = spherical_harmonics(directions @ frame, sphere_order) @ spherical
    direct = projection.reconstruct(brdf, directions) * lit @ np.repeat(2 * t * weights * 2 * np.pi / 64, 64)
    assert abs(incoming @ brdf - direct) < 1e-6


@pytest.mark.parametrize("order", [2, 3, 10])
def test_a18_white_furnace(order: int):
    quadrature = hemisphere_quadrature(20, 41)
    light = projection.project(np.ones(len(quadrature.weights)), quadrature, order)
    white = brdf_coefficients(ward(1, 1, specular=0.0, diffuse=1.0), random_upper(20), order, quadrature=quadrature)[..., 0]
    np.testing.assert_allclose(white @ light, 1.0, atol=1e-10)


def test_a19_paraboloid_round_trip():
    directions = random_upper(1000)
    np.testing.assert_allclose(paraboloid_direction(paraboloid(directions)), directions, atol=1e-12)


@cache
def phong_20_table(size: int) -> BrdfTable:
    return brdf_table(phong(20), 10, size, quadrature=hemisphere_quadrature(40, 60))


@pytest.mark.parametrize(("size", "low", "high"), [(32, 0.02, 0.03), (64, 0.0, 0.01)])
def test_a20_paraboloid_table_error(size: int, low: float, high: float):
    outgoing = random_upper(400)
    exact = brdf_coefficients(phong(20), outgoing, 10)[..., 0]
    found = phong_20_table(size).lookup(outgoing)[..., 0]
    relative = np.linalg.norm(found - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert low < np.sqrt(np.mean(relative**2)) < high


COMPUTE = """
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Table { float table[]; };
layout(std430, binding = 1) readonly buffer Outgoing { float outgoing[]; };
layout(std430, binding = 2) readonly buffer Light { float light[]; };
layout(std430, binding = 3) writeonly buffer Result { float result[]; };
float hsh_table(int row, int column, int i) { return table[(row * SIZE + column) * HSH_ORDER * HSH_ORDER + i]; }
#include "hsh.glsl"
void main() {
    int k = int(gl_GlobalInvocationID.x);
    if (3 * k >= outgoing.length()) return;
    vec3 d = vec3(outgoing[3 * k], outgoing[3 * k + 1], outgoing[3 * k + 2]);
    ivec2 corner;
    vec2 weight;
    hsh_place(d, SIZE, corner, weight);
    float values[HSH_COUNT];
    hsh_basis(d, values);
    float total = 0.0;
    for (int i = 0; i < HSH_COUNT; ++i) {
        total += hsh_coefficient(i, corner, weight) * light[i];
        result[k * (HSH_COUNT + 1) + 1 + i] = values[i];
    }
    result[k * (HSH_COUNT + 1)] = total;
}
"""


@pytest.mark.gl
def test_a21_device_equals_numpy():
    """Dot products of looked-up coefficients, and basis values in the device's float32.

    Values: 2μ - 1 is off by 6e-8 at most and |dH/dx| ≤ √(19/2π) · 45 = 78 at degree 9: 5e-6; as much again for the recurrence.
    """
    from renderers.gl.context import context
    from renderers.gl.programs import FOLDER

    order, size, directions = 10, 16, random_upper(300).astype(np.float32)
    table = brdf_table(phong(20), order, size)
    light = projection.project(PLAIN.directions[:, 0] ** 2 + 0.5, PLAIN, order).astype(np.float32)
    head = f"#version 430\n#define HSH_ORDER {order}\n#define SIZE {size}\n"
    text = head + COMPUTE.replace('#include "hsh.glsl"', (FOLDER / "hsh.glsl").read_text())
    ctx = context()
    inputs = [ctx.buffer(np.ascontiguousarray(a).tobytes()) for a in (table.coefficients, directions, light)]
    output = ctx.buffer(reserve=len(directions) * (order**2 + 1) * 4)
    for binding, buffer in enumerate([*inputs, output]):
        buffer.bind_to_storage_buffer(binding)
    shader = ctx.compute_shader(text)
    shader.run(group_x=(len(directions) + 63) // 64)
    result = np.frombuffer(output.read(), np.float32).reshape(len(directions), -1)
    products = table.lookup(directions.astype(np.float64))[..., 0].astype(np.float64) @ light
    np.testing.assert_allclose(result[:, 0], products, rtol=1e-5)
    exact = hemispherical_harmonics(directions.astype(np.float64), order)
    assert np.abs(result[:, 1:] - exact).max() < 1e-5
    for resource in (*inputs, output, shader):
        resource.release()


def test_a22_irradiance_after_a_tilt():
    """Order 10; the true value integrates the cut radiance over the tilted hemisphere."""
    lobe = lambda d: np.maximum(0, d @ tilted(20)) ** 3 + 0.2  # noqa: E731
    coefficients = projection.project(lobe(FINE.directions), FINE, 10)[None]
    for tilt in (5, 10, 20, 30):
        beta = float(np.radians(tilt))
        kept = lune_quadrature(0, np.pi - beta, 96)
        truth = lobe(kept.directions @ about_y(beta)) * kept.directions[:, 2] @ kept.weights
        for method in ("precomputed", "spherical"):
            turned = rotate(coefficients, about_y(beta), method)[0]
            assert abs(projection.irradiance(turned) / truth - 1) < 0.002, (tilt, method)


@pytest.mark.parametrize(("order", "error"), [(2, 0.303), (4, 0.154), (6, 0.103), (10, 0.061)])
def test_hard_1_functions_that_vary_along_the_horizon(order: int, error: float):
    values = FINE.directions[:, 0]
    assert abs(np.sqrt(1 - captured("hemispherical", values, FINE, order**2)) - error) < 0.002
    assert (
        np.abs(hemispherical_harmonics(directions_of(np.zeros(8), np.arange(8.0)), order)[:, degrees(order)[1] != 0]).max() < 1e-7
    )


@pytest.mark.parametrize(("order", "share"), [(2, 0.875), (4, 0.930), (6, 0.951), (8, 0.963), (10, 0.970)])
def test_hard_2_step_across_the_pole(order: int, share: float):
    assert abs(captured("hemispherical", (FINE.directions[:, 0] > 0).astype(float), FINE, order**2) - share) < 0.002


@pytest.mark.parametrize(("z", "clamped"), [(1 + 1e-7, 1.0), (-1e-7, 0.0)])
def test_hard_3_rounded_directions(z: float, clamped: float):
    x = np.sqrt(max(0, 1 - z * z))
    values, expected = (hemispherical_harmonics(np.array([[x, 0, c]]), 10) for c in (z, clamped))
    assert np.isfinite(values).all()
    np.testing.assert_array_equal(values, expected)


def test_hard_3_directions_below_the_horizon_and_nan_are_refused():
    for z in (-0.01, np.nan):
        with pytest.raises(ValueError, match="upper hemisphere"):
            hemispherical_harmonics(np.array([[1.0, 0, z]]), 3)


def test_hard_4_the_pole_has_no_azimuth():
    values = hemispherical_harmonics(directions_of(np.ones(7), np.linspace(0, 6, 7)), 20)
    assert np.abs(values - values[0]).max() < 1e-12


@pytest.mark.parametrize("order", [5, 10, 16, 20])
def test_hard_5_float32(order: int):
    rng = np.random.default_rng(9)
    mu = np.concatenate([rng.random(5000), 1e-3 * rng.random(2500), 1 - 1e-3 * rng.random(2500)])
    directions = directions_of(mu, 2 * np.pi * rng.random(len(mu))).astype(np.float32)
    values, exact = hemispherical_harmonics(directions, order), hemispherical_harmonics(directions.astype(np.float64), order)
    assert values.dtype == np.float32
    assert np.abs(values - exact).max() < {5: 8e-7, 10: 4e-6, 16: 1e-5, 20: 2e-5}[order]


@pytest.mark.parametrize("method", ["precomputed", "spherical", "analytic"])
def test_hard_6_tiny_rotations(method):
    coefficients = np.random.default_rng(1).standard_normal((1, 100))
    turned = rotate(coefficients, Rotation.from_rotvec([1e-8, 2e-8, 1e-8]).as_matrix(), method)
    assert np.abs(turned - coefficients).max() < 1e-6


def test_hard_7_upside_down():
    coefficients = np.random.default_rng(1).standard_normal((1, 25))
    assert np.abs(rotate(coefficients, about_y(np.pi))).max() < 1e-12
    with pytest.raises(ValueError, match="90 degrees"):
        rotate(coefficients, about_y(np.radians(91)), "analytic")
    quarter = rotate(coefficients, about_y(np.pi / 2), "analytic")
    assert np.isfinite(quarter).all()


@pytest.mark.parametrize("order", [5, 10])
def test_hard_8_two_turns_are_not_one(order: int):
    half, whole = rotation_matrix_y(0.3, order).T, rotation_matrix_y(0.6, order).T
    assert 0.1 < norm2(half @ half - whole) < 0.6
    coefficients = np.random.default_rng(1).standard_normal((1, order**2))
    back = rotate(rotate(coefficients, about_y(0.3)), about_y(-0.3))
    assert np.linalg.norm(back) <= np.linalg.norm(coefficients)


def test_hard_9_the_cosine_enters_once():
    from renderers.scene.world import LAMBERT
    from renderers.transport.brdf import Materials

    one = np.ones(1)
    lambert = of_material(Materials(np.full(1, LAMBERT, np.int32), np.array([[0.8, 0.5, 0.1]]), np.zeros((1, 3)), one, one, one))
    light = np.zeros((25, 1))
    light[0] = np.sqrt(2 * np.pi)
    reflected = projection.product(brdf_coefficients(lambert, tilted(30)[None], 5), light)
    np.testing.assert_allclose(reflected, [[0.8, 0.5, 0.1]], atol=1e-10)


def test_hard_10_negative_radiance_is_counted():
    coefficients = brdf_coefficients(phong(20), tilted(0)[None], 7, cosine=False)[0, :, 0]
    values = projection.reconstruct(coefficients, PLAIN.directions)
    radiance, count = projection.clamped(values)
    assert count == (values < 0).sum() > 0
    assert radiance.min() == 0


def test_hard_11_rim_of_the_paraboloid_map():
    phi = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    outgoing = directions_of(np.full(60, np.cos(np.radians(89.9))), phi)
    exact = brdf_coefficients(phong(20), outgoing, 10)[..., 0]
    table = phong_20_table(64)
    assert np.abs(table.coefficients).max(axis=(2, 3)).min() > 0
    relative = np.linalg.norm(table.lookup(outgoing)[..., 0] - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert relative.max() < 0.1


def test_hard_12_ward_at_grazing_angles():
    for cosine, tolerance in ((True, 1e-4), (False, 0.02)):
        coarse, fine = (
            brdf_coefficients(ward(0.2, 0.5), tilted(75)[None], 10, cosine, hemisphere_quadrature(48 * k, 96 * k)) for k in (1, 2)
        )
        assert np.isfinite(coarse).all()
        assert np.linalg.norm(coarse - fine) < tolerance * np.linalg.norm(fine)


def test_hard_13_too_glossy():
    assert [order_for(e) for e in (1, 5, 15, 20, 50)] == [5, 5, 8, 9, None]
    missed = []
    for exponent in (20, 50):
        lobe = phong(exponent)(FINE.directions, tilted(30)) * FINE.directions[:, 2]
        missed.append(np.sqrt(1 - captured("hemispherical", lobe, FINE, 100)))
    assert missed[0] < 0.02
    assert missed[1] > 0.1


def test_hard_14_light_below_the_horizon_counts_for_nothing():
    """An environment 1 below and 0 above the horizon: its SH coefficients in closed quadrature, then the conversion."""
    below = Quadrature(PLAIN.directions * [1, 1, -1], PLAIN.weights)
    spherical = spherical_harmonics(below.directions, 30).T @ below.weights
    brdf = brdf_coefficients(phong(5), tilted(30)[None], 5)[0, :, 0]
    assert abs(to_hemispherical(spherical, 5) @ brdf) < 0.002
    assert abs(brdf[0] * np.sqrt(2 * np.pi)) > 0.5  # what it would be from above


def test_ringing_of_order_7():
    """Phong 20 without cosine: spherical harmonics undershoot by 4.6 % of the peak, hemispherical ones by less than half of it."""
    values = phong(20)(PLAIN.directions, tilted(0))
    lowest = []
    for basis in (hemispherical_harmonics, spherical_harmonics):
        functions = basis(PLAIN.directions, 7)
        lowest.append((functions @ (functions.T @ (values * PLAIN.weights))).min() / values.max())
    np.testing.assert_allclose(lowest, [-0.0145, -0.046], atol=0.003)


@pytest.mark.parametrize(("order", "worst"), [(5, 0.0012), (10, 0.006)])
def test_rotation_table_between_its_angles(order: int, worst: float):
    table = lune_table("rotation", order)
    last = len(table.even) - 1
    for k in (0, 1, 5, 20, 64, last - 1):
        middle = np.pi / 2 * ((k + 0.5) / last) ** 1.5
        assert norm2(table.matrix(middle) - rotation_matrix_y(middle, order)) < worst
