"""Parts of irradiance caching one by one: weights and zones, splat against gather, gradients, limits, records."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.transport.caching.gradients import polar_moments
from renderers.transport.caching.hemisphere import grid_of
from renderers.transport.caching.limits import Limits, limited
from renderers.transport.caching.records import Records
from renderers.transport.caching.splat import Canvas, gather
from renderers.transport.caching.splat_kernels import weight_at
from renderers.transport.caching.weights import CAP, WEIGHTS, weight

F64 = NDArray[np.float64]
WARD = WEIGHTS["ward"]


def unit(rng: np.random.Generator, count: int) -> F64:
    v = rng.normal(size=(count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def random_records(rng: np.random.Generator, count: int, flat: float = 0.3) -> Records:
    normal = np.array([0, 0, 1.0]) + flat * unit(rng, count)
    return Records(
        position=rng.uniform(-1, 1, (count, 3)) * [1, 1, 0.1],
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        radius=rng.uniform(0.1, 1, count),
        irradiance=rng.uniform(0, 2, (count, 3)),
        translation=rng.normal(size=(count, 3, 3)),
        rotation=rng.normal(size=(count, 3, 3)),
    )


def random_canvas(rng: np.random.Generator, dtype: type = np.float64, side: int = 48) -> Canvas:
    """A wavy sheet seen from above; one pixel in eight is background."""
    y, x = np.divmod(np.arange(side * side), side)
    position = np.stack([x / side * 2 - 1, y / side * 2 - 1, 0.05 * np.sin(x / 5)], axis=1)
    normal = np.stack([-0.05 * np.cos(x / 5), 0 * x, 1 + 0.0 * x], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.flatnonzero(rng.random(side * side) < 7 / 8)
    return Canvas(rows, side, position[rows], normal[rows], dtype)


def test_r1_the_zone_of_influence_lies_inside_its_sphere() -> None:
    """10⁶ pairs of points and records drawn around the rim; a contributing one is never farther than a·R."""
    rng, count, a = np.random.default_rng(1), 1_000_000, 0.3
    n, nk, radius = unit(rng, count), unit(rng, count), rng.uniform(0.1, 2, count)
    n = n * rng.uniform(0, 0.2, (count, 1)) + nk
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    offset = unit(rng, count) * (a * radius * rng.uniform(0, 1.2, count))[:, None]
    bend = np.linalg.norm(n - nk, axis=1) / np.sqrt(2)
    e = np.linalg.norm(offset, axis=1) / radius + bend
    inside = e <= a
    assert inside.sum() > 100_000
    reach = np.linalg.norm(offset[inside], axis=1) / (a * radius[inside])
    assert 0.99 < reach.max() <= 1
    # and the kernel says the same, one by one
    zero = np.zeros(3)
    some = rng.integers(0, count, 2000)
    kernel = [weight_at(WARD, offset[i], n[i], zero, nk[i], radius[i], a) for i in some]
    assert np.array_equal(np.array(kernel) > 0, inside[some])


def test_h1_equal_normals_in_float32_give_no_nan_and_no_bend() -> None:
    rng, a = np.random.default_rng(2), np.float32(0.5)
    zero, p, radius = np.zeros(3, np.float32), np.array([0.1, 0.2, 0.05], np.float32), np.float32(1)
    expected = 1 / np.sqrt(np.sum(p.astype(np.float64) ** 2))
    normals = unit(rng, 100_000).astype(np.float32)
    values = np.array([weight_at(WARD, p, n, zero, n, radius, a) for n in normals])
    assert np.isfinite(values).all()
    # one float32 square root: all the same, within its rounding of 6e-8
    np.testing.assert_allclose(values, expected, rtol=2e-7)


def test_h2_the_record_itself_is_finite_and_wins() -> None:
    records = random_records(np.random.default_rng(3), 40)
    here = records.rows(slice(7, 8))
    value, total = gather(here.position, here.normal, records, 0.5)
    assert total[0] >= 1 / CAP
    assert np.isfinite(value).all()
    # the others' share of the weight, times the largest difference that values of 0 … 2 with gradients of at most 4 may have here
    share = 1 - 1 / CAP / total[0]
    assert share < 0.1
    assert np.abs(value - here.irradiance).max() <= 4 * share
    alone, total = gather(here.position, here.normal, here, 0.5)
    assert total[0] == 1 / CAP
    np.testing.assert_allclose(alone, here.irradiance, rtol=1e-15)


@pytest.mark.parametrize("kind", ["ward", "shifted", "tent"])
def test_weights_fall_with_the_error_and_end_at_the_rim(kind: str) -> None:
    a = 0.4
    values = [weight(WEIGHTS[kind], d, 0.05, a) for d in np.linspace(0, 0.5, 501)]  # type: ignore[index]
    assert all(x >= y for x, y in pairwise(values))
    assert values[0] > 0
    assert values[-1] == 0
    if kind == "ward":
        assert min(v for v in values if v) >= 1 / a
    else:  # no step at the rim
        assert min(v for v in values if v) < 0.01 * values[0]


@pytest.mark.parametrize("kind", ["ward", "shifted", "tent"])
def test_r17_splat_equals_gather(kind: str) -> None:
    rng = np.random.default_rng(4)
    records, canvas = random_records(rng, 300), random_canvas(rng)
    canvas.add(records, 0.35, kind)  # type: ignore[arg-type]
    value, total = gather(canvas.position, canvas.normal, records, 0.35, kind)  # type: ignore[arg-type]
    assert 0 < canvas.missed.sum() < 0.5 * len(canvas)
    np.testing.assert_allclose(canvas.sums[:, 3], total, rtol=1e-12)
    np.testing.assert_allclose(canvas.irradiance, value, rtol=1e-12, atol=1e-12)


def test_r18_the_order_of_records_does_not_matter_in_float32() -> None:
    rng = np.random.default_rng(5)
    records, canvas = random_records(rng, 400), random_canvas(rng, np.float32)
    canvas.add(records, 0.35)
    first = canvas.irradiance
    canvas.clear()
    canvas.add(records.rows(rng.permutation(400)), 0.35)
    # sums of at most 60 positive terms: relative rounding under 60 · 6e-8
    np.testing.assert_allclose(canvas.irradiance, first, rtol=1e-5)


def test_h17_old_records_are_not_counted_twice_and_parts_add_up() -> None:
    rng = np.random.default_rng(6)
    records, canvas = random_records(rng, 200), random_canvas(rng)
    canvas.add(records, 0.3)
    whole = canvas.sums.copy()
    canvas.clear()
    for start in range(0, 200, 50):
        canvas.add(records.rows(slice(start, start + 50)), 0.3)
    np.testing.assert_array_equal(canvas.sums, whole)


def test_h5_extrapolation_never_goes_below_zero() -> None:
    rng = np.random.default_rng(7)
    records, canvas = random_records(rng, 200), random_canvas(rng)
    plain = canvas.irradiance
    canvas.add(records, 0.6)
    assert (canvas.irradiance >= 0).all()
    negative = records.irradiance[:, None] + np.einsum("kcx,px->kpc", records.translation, canvas.position[:50])
    assert (negative < 0).any()
    assert plain.max() == 0


@pytest.mark.parametrize("a", [np.sqrt(2), 2.0, 0.0, -0.1])
def test_h13_accuracies_that_share_records_through_walls_are_refused(a: float) -> None:
    canvas = random_canvas(np.random.default_rng(8))
    with pytest.raises(ValueError, match="accuracy"):
        canvas.add(Records.empty(), a)


def test_h6_opposite_faces_never_share_records() -> None:
    record = random_records(np.random.default_rng(9), 1)
    for a in (0.2, 1.0, 1.4):
        assert gather(record.position, -record.normal, record, a)[1][0] == 0
        assert gather(record.position, record.normal, record, a)[1][0] > 0


def numpy_moments(light: F64, distance: F64, combine: object = np.minimum) -> tuple[F64, F64, F64]:
    """Ward & Heckbert's sums written down as printed, one channel: E, translation, rotation (x, y)."""
    rings, sectors = distance.shape
    j = np.arange(rings + 1)
    theta = np.arcsin(np.sqrt(j / rings))
    phi = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    edge = phi - np.pi / sectors
    t = np.zeros(2)
    for k in range(sectors):
        u, v = np.array([np.cos(phi[k]), np.sin(phi[k])]), np.array([-np.sin(edge[k]), np.cos(edge[k])])
        for i in range(rings):
            if i:
                near = combine(distance[i, k], distance[i - 1, k])  # type: ignore[operator]
                t += u * 2 * np.pi / sectors * np.sin(theta[i]) * np.cos(theta[i]) ** 2 / near * (light[i, k] - light[i - 1, k])
            near = combine(distance[i, k], distance[i, k - 1])  # type: ignore[operator]
            t += v * (np.sin(theta[i + 1]) - np.sin(theta[i])) / near * (light[i, k] - light[i, k - 1])
    swept = (theta - np.sin(theta) * np.cos(theta)) / 2
    turn = np.stack([-np.sin(phi), np.cos(phi)]) @ (light.T @ np.diff(swept)) * 2 * np.pi / sectors
    return np.pi / light.size * light.sum(), t, turn


def test_moments_equal_the_printed_sums() -> None:
    rng = np.random.default_rng(10)
    light, distance = rng.random((3, 8, 25, 3)), rng.uniform(0.2, 3, (3, 8, 25))
    moments = polar_moments(light, 1 / distance)
    for k in range(3):
        for c in range(3):
            e, t, r = numpy_moments(light[k, ..., c], distance[k])
            assert moments.irradiance[k, c] == pytest.approx(e, rel=1e-12)
            np.testing.assert_allclose(moments.translation[k, c], t, rtol=1e-11, atol=1e-13)
            np.testing.assert_allclose(moments.rotation[k, c], r, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(moments.radius, 1 / (1 / distance).mean(axis=(1, 2)), rtol=1e-12)


def test_r6_constant_radiance_gives_pi_and_no_gradients() -> None:
    """The gradients are sums of differences, exactly 0, and of unit vectors around a circle, 0 to rounding."""
    rng = np.random.default_rng(11)
    moments = polar_moments(np.ones((2, 32, 100, 3)), 1 / rng.uniform(0.1, 5, (2, 32, 100)))
    np.testing.assert_allclose(moments.irradiance, np.pi, rtol=1e-12)
    assert not moments.translation.any()
    assert np.abs(moments.rotation).max() < 1e-12


@pytest.mark.parametrize("rays", [16, 800, 4096, 8192])
def test_grids_have_nearly_square_cells(rays: int) -> None:
    grid = grid_of(rays)
    assert abs(grid.cells - rays) <= 0.06 * rays
    assert grid.sectors / grid.rings == pytest.approx(np.pi, rel=0.3)


def one_record(radius: float, irradiance: float, slope: float) -> Records:
    r = Records.empty()
    return Records(
        np.zeros((1, 3)), np.array([[0, 0, 1.0]]), np.array([radius]), np.full((1, 3), irradiance),
        np.tile(np.array([slope, 0, 0]), (1, 3, 1)), np.zeros((1, 3, 3)), r.coefficients,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("radius", "slope", "expected_radius", "expected_slope"),
    [
        (0.5, 1.0, 0.5, 1.0),  # nothing to do: E/|grad| = 2
        (0.5, 8.0, 0.25, 8.0),  # rule 1
        (0.02, 1.0, 0.1, 0.2),  # rule 3 and rule 4
        (0.5, 100.0, 0.1, 20.0),  # rule 1 (0.02), 3 and 4
        (5.0, 0.0, 2.0, 0.0),  # largest
        (np.inf, 0.0, 2.0, 0.0),  # nothing hit
    ],
)
def test_limits_of_radius_and_gradient(radius: float, slope: float, expected_radius: float, expected_slope: float) -> None:
    out = limited(one_record(radius, 2.0, slope), Limits(0.1, 2.0))
    assert out.radius[0] == pytest.approx(expected_radius)
    assert out.translation[0, 0, 0] == pytest.approx(expected_slope)


def test_neighbours_limit_each_other() -> None:
    records = Records.joined([one_record(r, 1, 0) for r in (0.2, 1.5, 2.0)])
    position = np.array([[0, 0, 0], [0.3, 0, 0], [3.0, 0, 0]], np.float64)
    records = Records(position, *(getattr(records, n) for n in ("normal", "radius", "irradiance", "translation", "rotation")))
    out = limited(records, Limits(0.1, 9.0, neighbours=True))
    np.testing.assert_allclose(out.radius, [0.2, 0.5, 2.0])
    late = limited(records.rows([1]), Limits(0.1, 9.0, neighbours=True), records.rows([0]))
    np.testing.assert_allclose(late.radius, [0.5])


def test_radii_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="radii"):
        Limits(0.5, 0.1)


def test_records_join_and_convert() -> None:
    records = random_records(np.random.default_rng(12), 5)
    both = Records.joined([Records.empty(), records, records.rows([0])])
    assert len(both) == 6
    np.testing.assert_array_equal(both.irradiance[5], records.irradiance[0])
    assert both.astype(np.float32).translation.dtype == np.float32
    with_lobes = Records(
        *(getattr(records, n) for n in ("position", "normal", "radius", "irradiance", "translation", "rotation")),
        np.zeros((5, 4, 3)),
    )
    with pytest.raises(ValueError, match="coefficients"):
        Records.joined([records, with_lobes])
