"""Hemicubes: weights, gradients and curvature against closed forms and against polar hemispheres; no OpenGL."""

import numpy as np
import pytest
from caching_rooms import POINTS_1, Constant, Radiance1, room_1, sites
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.cube import cube_tables, harmonic_tables, size_of
from renderers.transport.caching.hemicube import HemicubeSampler, cube_moments
from renderers.transport.caching.hemisphere import Grid, PolarSampler
from renderers.transport.caching.radiance import RadianceSampler
from renderers.transport.caching.records import Sites
from renderers.transport.hemispherical.basis import hemispherical_harmonics
from renderers.transport.seen import Seen

F64 = NDArray[np.float64]


@pytest.fixture(scope="module")
def first() -> World:
    return room_1().world()


def relative(found: F64, expected: F64) -> F64:
    return np.asarray(np.linalg.norm(found - expected, axis=1) / np.linalg.norm(expected, axis=1))


@pytest.mark.parametrize("size", [2, 8, 36])
def test_r3_weights_integrate_to_what_they_stand_for(size: int) -> None:
    tables = cube_tables(size)
    assert tables.cosine.sum() == pytest.approx(np.pi, abs=1e-12)
    assert tables.solid.sum() == pytest.approx(2 * np.pi, abs=1e-12)
    assert min(tables.cosine.min(), tables.solid.min()) > 0
    np.testing.assert_allclose(tables.turn.sum(axis=0), 0, atol=1e-12)
    within = 2 * size * (size - 1) + 4 * (size // 2 * (size - 1) + (size // 2 - 1) * size)
    assert len(tables.first) == within + 4 * size + 4 * (size // 2)
    np.testing.assert_allclose(np.linalg.norm(tables.direction, axis=1), 1, atol=1e-12)


def test_weights_against_directions_drawn_at_random() -> None:
    """10⁵ cosine-distributed directions given to their texels: counts within 4.5 binomial deviations (48 texels; fixed seed)."""
    rng, size, count = np.random.default_rng(3), 4, 100_000
    r, phi = np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    d = np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r * r)], axis=1)
    d /= np.abs(d).max(axis=1, keepdims=True)
    tables = cube_tables(size)
    centre = tables.direction / np.abs(tables.direction).max(axis=1, keepdims=True)
    texel = np.abs(d[:, None] - centre).max(axis=2).argmin(axis=1)
    found, expected = np.bincount(texel, minlength=len(centre)) / count, tables.cosine / np.pi
    assert (np.abs(found - expected) <= 4.5 * np.sqrt(expected * (1 - expected) / count)).all()


def test_harmonics_of_a_constant_and_of_a_harmonic() -> None:
    """∫ H_0 is √2π, all others vanish; what is built of one harmonic projects back on it, to the width of a texel."""
    tables, harmonics = cube_tables(36), harmonic_tables(36, 6)
    sums = harmonics.inside.sum(axis=1, dtype=np.float64)
    expected = np.zeros(36)
    expected[0] = np.sqrt(2 * np.pi)
    # 3 × 3 points of Gauss a texel; near the horizon harmonics of odd m rise as √μ
    np.testing.assert_allclose(sums, expected, atol=2e-4)
    product = harmonics.inside[:9] @ hemispherical_harmonics(tables.direction, 3)
    np.testing.assert_allclose(product, np.eye(9), atol=0.02)


def half_plane(size: int, height: float, offset: float, fine: int = 8) -> tuple[F64, F64]:
    """Radiance (1, P, 3) and nearness (1, P) under a plane `height` above, 1 where x > offset; texels: means of fine² parts."""
    tables = cube_tables(size * fine)
    distance = height / tables.direction[:, 2]
    bright = (distance * tables.direction[:, 0] > offset).astype(float)
    coarse = cube_tables(size).direction
    coarse = coarse / np.abs(coarse).max(axis=1, keepdims=True)
    place = np.round((coarse + 1) * size / 2 * 1e3)
    row = {tuple(key): k for k, key in enumerate(place.tolist())}
    centre = tables.direction / np.abs(tables.direction).max(axis=1, keepdims=True)
    parent = (np.floor((centre + 1) * size / 2 - 1e-9) + 0.5) * 2 / size - 1
    parent[np.abs(centre) > 1 - 1e-9] = np.sign(centre[np.abs(centre) > 1 - 1e-9])
    index = np.array([row[tuple(key)] for key in np.round((parent + 1) * size / 2 * 1e3).tolist()])
    weight = np.bincount(index, tables.cosine, len(coarse))
    light, near = (np.bincount(index, v * tables.cosine, len(coarse)) / weight for v in (bright, 1 / distance))
    return np.repeat(light[None, :, None], 3, axis=2), near[None]


@pytest.mark.parametrize(("height", "offset"), [(0.5, 0.3), (0.5, -0.1), (1.0, 0.7)])
def test_gradient_and_hessian_of_a_half_lit_plane(height: float, offset: float) -> None:
    """E = π/2 (1 - u/√(u² + h²)), E' = π/2 h² (u² + h²)^-3/2, E'' = 3π/2 h² u (u² + h²)^-5/2 along x, nothing along y."""
    square = offset**2 + height**2
    bent = 1.5 * np.pi * height**2 * offset * square**-2.5
    for size, close in ((16, 0.05), (32, 0.02)):
        found = cube_moments(*half_plane(size, height, offset), size)
        slope = np.pi / 2 * height**2 * square**-1.5
        # the light's edge lies half a part's width off its place at most, a part is 2 height / (8 size) wide
        assert found.irradiance[0, 0] == pytest.approx(np.pi / 2 * (1 - offset / np.sqrt(square)), abs=slope * height / (8 * size))
        np.testing.assert_allclose(found.translation[0, 0], [slope, 0], rtol=close, atol=1e-9)
        assert found.hessian[0, 0] == pytest.approx(bent, rel=2 * close)
        assert abs(found.hessian[0, 1]) < 1e-9
        assert abs(found.hessian[0, 2]) < 2 * close * abs(bent)


def test_r14_harmonic_mean_distance_under_a_parallel_plane() -> None:
    tables = cube_tables(36)
    found = cube_moments(np.zeros((1, len(tables.cosine), 3)), tables.direction[None, :, 2] / 0.7, 36)
    assert found.radius[0] == pytest.approx(1.5 * 0.7, rel=1e-3)


def test_r6_constant_radiance(first: World) -> None:
    here = sites(first, POINTS_1[:, 0], POINTS_1[:, 1])
    records = HemicubeSampler(first, 24, Constant(1.0))(here)
    np.testing.assert_allclose(records.irradiance, np.pi, rtol=1e-9)
    assert np.abs(records.translation).max() < 1e-12
    assert np.abs(records.rotation).max() < 1e-12
    glossy = HemicubeSampler(first, 24, Constant(1.0), order=6)(here)
    assert glossy.coefficients is not None
    np.testing.assert_allclose(glossy.coefficients[:, 0], np.sqrt(2 * np.pi), rtol=1e-4)
    assert np.abs(glossy.coefficients[:, 1:]).max() < 1e-3
    assert not np.any(glossy.coefficient_gradients)


def test_r7_r10_irradiance_and_gradients_of_room_1(first: World) -> None:
    """64² faces at six points away from walls: the bounds of the polar hemisphere's 32×100 cells, from a third more rays."""
    records = HemicubeSampler(first, 64, Radiance1(first))(sites(first, POINTS_1[:6, 0], POINTS_1[:6, 1]))
    np.testing.assert_allclose(records.irradiance[:, 0], POINTS_1[:6, 2, 0], rtol=5e-3)
    assert relative(records.translation[:, 0] * first.scale, POINTS_1[:6, 3]).max() <= 0.10
    assert relative(records.rotation[:, 0], POINTS_1[:6, 4]).max() <= 0.05


def test_curvature_is_that_of_fine_polar_hemispheres(first: World) -> None:
    here = sites(first, POINTS_1[:6, 0], POINTS_1[:6, 1])
    polar = PolarSampler(first, Grid(128, 400), Radiance1(first), jitter=False)(here)
    cubes = HemicubeSampler(first, 64, Radiance1(first))(here)
    assert polar.curvature is not None
    assert cubes.curvature is not None
    # the radius is its fourth root: 10 % here are 2.4 % there
    np.testing.assert_allclose(cubes.curvature, polar.curvature, rtol=0.10)


def test_r12_r13_coefficients_and_their_gradients(first: World) -> None:
    """Order 5 against polar hemispheres of 200×600 cells, and irradiance from them against irradiance records."""
    here = sites(first, POINTS_1[:6, 0], POINTS_1[:6, 1])
    polar = RadianceSampler(first, Grid(200, 600), Radiance1(first), 5, jitter=False)(here)
    glossy, plain = (HemicubeSampler(first, 64, Radiance1(first), order=order)(here) for order in (5, None))
    for name, bound in (("coefficients", 0.01), ("coefficient_gradients", 0.12)):
        found, expected = (np.asarray(getattr(r, name)).reshape(6, -1) for r in (glossy, polar))
        assert relative(found, expected).max() <= bound, name
    np.testing.assert_allclose(glossy.irradiance, plain.irradiance, rtol=1e-3)
    assert relative(glossy.translation[:, 0], plain.translation[:, 0]).max() < 0.06
    np.testing.assert_allclose(glossy.rotation, plain.rotation, atol=1e-6)
    np.testing.assert_allclose(glossy.radius, plain.radius, rtol=1e-9)


class Lamp:
    """Radiance 1 from the rectangle |x|, |y| ≤ half of the ceiling z = 3, as `Incoming`."""

    def __init__(self, world: World, half: float) -> None:
        self._world, self._half = world, half

    def __call__(self, seen: Seen, random: F64) -> tuple[NDArray[np.float32], int]:
        p = self._world.centre + seen.position / self._world.scale
        lit = (p[:, 2] > 3 - 1e-4) & (np.abs(p[:, :2]) <= self._half).all(axis=1)
        return np.repeat(lit[:, None], 3, axis=1).astype(np.float32), 0


def polygon_irradiance(point: F64, normal: F64, corners: F64) -> float:
    """Lambert's closed form of the irradiance of a polygon of radiance 1: ½ Σ φ_e m_e · n."""
    v = corners - point
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    after = np.roll(v, -1, axis=0)
    across = np.cross(v, after)
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, (v * after).sum(axis=1))
    return float(abs((across / sine[:, None] @ normal * angle).sum()) / 2)


def test_form_factor_of_a_rectangular_lamp() -> None:
    """Room without light: 20 floor points against Lambert's form factor of a 2 m × 2 m lamp on the ceiling.

    A texel is lit or not, and the lamp's edges run along rows of texels: so many rows are lit as the lamp is wide, 10 for faces of
    32², off by √(1/6) of one in the RMS, 4 %, and in both directions together 5.8 %. Of 128², a quarter of that.
    """
    world = room_1().world()
    places = np.concatenate([np.random.default_rng(5).uniform(-1.8, 0.3, (20, 2)), np.zeros((20, 1))], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (20, 1))
    corners = np.array([(-1, -1, 3), (1, -1, 3), (1, 1, 3), (-1, 1, 3)], float)
    expected = np.array([polygon_irradiance(p, up[0], corners) for p in places])
    errors = []
    for size in (32, 128):
        found = HemicubeSampler(world, size, Lamp(world, 1.0))(sites(world, places, up)).irradiance[:, 0]
        errors.append(np.sqrt(np.mean((found / expected - 1) ** 2)))
    assert errors[0] <= 0.08
    assert errors[1] <= 0.4 * errors[0]


def test_records_depend_neither_on_batches_nor_on_numbers(first: World) -> None:
    here = sites(first, POINTS_1[:, 0], POINTS_1[:, 1])
    sampler = HemicubeSampler(first, 12, Radiance1(first))
    together, apart = sampler(here), [sampler(Sites(*(c[k : k + 1] for c in here)), k) for k in range(len(here.position))]
    np.testing.assert_array_equal(together.translation, np.concatenate([r.translation for r in apart]))


def test_sizes() -> None:
    assert [size_of(n) for n in (12, 1024, 4096, 16384)] == [2, 18, 36, 74]
    with pytest.raises(ValueError, match="at least 12"):
        size_of(11)
    with pytest.raises(ValueError, match="even"):
        cube_tables(7)
