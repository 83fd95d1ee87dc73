"""The published sampling plane, its weights, gradients and reprojection, and records in space and time, against exact lamps."""

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.scene.builtin.exact import polygon_irradiance
from renderers.transport.caching.plane import covered_cosine, plane_directions, plane_moments, plane_weights
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import gather
from renderers.transport.temporal.plane import Drawn, reprojected
from renderers.transport.temporal.records import Timed
from renderers.transport.temporal.trends import Trends

F64 = NDArray[np.float64]
SIDE, HALF = 64, 2.0
STEP = 2 * HALF / SIDE
DIRECTIONS = plane_directions(SIDE, HALF)


def weights(side: int = SIDE, half: float = HALF) -> F64:
    return plane_weights(side, half).cosine


def centres(side: int = SIDE, half: float = HALF) -> tuple[F64, F64]:
    """x and y of the pixel centres, [x, y]."""
    along = (np.arange(side) + 0.5) * 2 * half / side - half
    x, y = np.meshgrid(along, along, indexing="ij")
    return x, y


def drawn_on_plane(points: F64) -> Drawn:
    """One plane's image (M, M)."""
    return Drawn(*(column[0] for column in reprojected(points[None], SIDE, HALF)))


def test_a5_weights_of_the_plane_sum_to_pi() -> None:
    assert abs(weights().sum() / np.pi - 1) <= 1e-4


@pytest.mark.parametrize("half", [1.0, 2.0, 3.0])
def test_a6_coverage_of_the_plane_without_border(half: float) -> None:
    q = half / np.sqrt(1 + half**2)
    expected = 4 / np.pi * q * np.arctan(q)
    assert plane_weights(64, half, "plane").cosine.sum() / np.pi == pytest.approx(expected, abs=1e-3)
    assert covered_cosine(half) == pytest.approx(expected)


def moments_of(radiance: F64, depth: F64) -> tuple[float, F64, F64]:
    """Irradiance, translation and rotation gradient (2,) of one plane's grey image (M, M) with depths along the normal."""
    x, y = centres(len(radiance))
    near = 1 / (depth * np.sqrt(1 + x**2 + y**2))
    found = plane_moments(np.repeat(radiance[None, ..., None], 3, axis=-1), near[None], HALF)
    return float(found.irradiance[0, 0]), found.translation[0, 0], found.rotation[0, 0]


def test_a8_rotation_gradient_of_simple_skies() -> None:
    """A constant sky has none; one of radiance 1 over x > 0 has ∫ sin²θ dθ ∫ cos φ dφ = π/4 · 2 = π/2 about y."""
    depth = np.full((SIDE, SIDE), 1e6)
    _, translation, rotation = moments_of(np.ones((SIDE, SIDE)), depth)
    assert np.abs(rotation).max() <= 1e-12
    assert np.abs(translation).max() == 0
    half = (centres()[0] > 0).astype(float)
    assert moments_of(half, depth)[2] == pytest.approx([0, np.pi / 2], abs=1e-4)


def lamp(at: F64, normal: F64) -> float:
    """Irradiance of a rectangle that faces down, at a point with a normal."""
    corners = np.array([(-0.3, -0.2, 1.0), (0.7, -0.2, 1.0), (0.7, 0.8, 1.0), (-0.3, 0.8, 1.0)]) - at
    return float(polygon_irradiance(np.zeros((1, 3)), normal, corners[::-1], 1.0)[0])


def test_a7_a8_gradients_of_a_rectangle() -> None:
    """Before a far background, seen from the origin upwards, against differences of the polygon formula. 256² pixels: edges fall
    within a quarter of a hundredth of the rectangle."""
    x, y = centres(256)
    lit = (x > -0.3) & (x < 0.7) & (y > -0.2) & (y < 0.8)
    irradiance, translation, rotation = moments_of(lit.astype(float), np.where(lit, 1.0, 1e6))
    up, h = np.array([0.0, 0, 1]), 1e-3
    assert irradiance == pytest.approx(lamp(np.zeros(3), up), rel=0.02)
    for axis in (0, 1):
        step = np.eye(3)[axis] * h
        moved = (lamp(step, up) - lamp(-step, up)) / (2 * h)
        # n_k × n = δ about this axis: n = n_k + δ × n_k
        turned = (lamp(np.zeros(3), up + np.cross(step, up)) - lamp(np.zeros(3), up - np.cross(step, up))) / (2 * h)
        assert translation[axis] == pytest.approx(moved, abs=0.02 * np.hypot(*translation))
        assert rotation[axis] == pytest.approx(turned, abs=0.02 * np.hypot(*rotation))


def test_a12_a_plane_reprojects_what_is_at_rest_onto_itself() -> None:
    depth = np.random.default_rng(0).uniform(0.5, 5, SIDE**2)
    drawn = drawn_on_plane(DIRECTIONS / DIRECTIONS[:, 2:] * depth[:, None])
    assert not drawn.holes.any()
    np.testing.assert_array_equal(drawn.source.ravel(), np.arange(SIDE**2))


def test_a27_h6_dead_zone_of_the_plane_and_h9_its_rim() -> None:
    """Moved sideways by less than half a pixel nothing changes; by more than a pixel it does; points may leave, or come behind."""
    points = DIRECTIONS / DIRECTIONS[:, 2:]
    near = np.abs(points[:, :2]).max(axis=1) < 0.5
    for share, changes in ((0.45, False), (1.1, True)):
        moved = points + np.where(near[:, None], [share * STEP, 0, -1e-3], 0)
        moved[:, :2] *= moved[:, 2:]
        drawn = drawn_on_plane(moved)
        assert (drawn.source.ravel() != np.arange(SIDE**2)).any() == changes
    gone = points + np.array([3.0, 0, 0])
    gone[::7, 2] = -1
    # every pixel shows some point: at most π times the brightest
    assert (drawn_on_plane(gone).source >= 0).all()
    assert weights().sum() <= np.pi * (1 + 1e-4)


def test_h9_a_plane_that_all_points_have_left_sees_nothing() -> None:
    points = np.repeat(DIRECTIONS[None], 2, axis=0)
    points[1, :, 2] = -1
    drawn = reprojected(points, SIDE, HALF)
    assert (drawn.source[0] >= 0).all()
    assert (drawn.source[1] == -1).all()
    assert drawn.holes[1].all()


def by_the_listing(points: F64) -> Drawn:
    """Listing 3.3 of the specification, in float64: one plane drawn from far to near, its holes filled pass by pass."""
    index = np.flatnonzero(points[:, 2] > 1e-6)
    at = np.floor((points[index, :2] / points[index, 2:] / HALF + 1) / 2 * SIDE + 1e-6).astype(int)
    inside = ((at >= 0) & (at < SIDE)).all(axis=1)
    index, (row, column) = index[inside], at[inside].T
    order = np.argsort(-points[index, 2], kind="stable")
    source, depth = np.full((SIDE, SIDE), -1), np.zeros((SIDE, SIDE))
    source[row[order], column[order]] = index[order]
    depth[row[order], column[order]] = points[index[order], 2]
    holes = source < 0
    while (source < 0).any():
        before = source.copy(), depth.copy()
        for j, k in np.argwhere(source < 0):
            around = [(a, b) for a in (j - 1, j, j + 1) for b in (k - 1, k, k + 1) if 0 <= a < SIDE and 0 <= b < SIDE]
            known = [cell for cell in around if before[0][cell] >= 0]
            if known:
                deepest = max(known, key=lambda cell: before[1][cell])
                source[j, k], depth[j, k] = before[0][deepest], before[1][deepest]
    return Drawn(source, depth, holes)


def test_planes_are_drawn_as_the_listing_says() -> None:
    """At most 0.2 % of the pixels differ (float32 where a point lands on a pixel's edge)."""
    for centre, shift in ((1.5, [0.2, 0.1, -0.3]), (1.0, [0, 0, 0.25])):
        hit, points = ball(centre)
        moved = points + np.where(hit[:, None], shift, 0)
        drawn, expected = drawn_on_plane(moved), by_the_listing(moved)
        assert expected.holes.sum() > 20
        assert (drawn.source == expected.source).mean() >= 0.998
        assert (drawn.holes == expected.holes).mean() >= 0.998


def ball(centre: float, radius: float = 0.3) -> tuple[NDArray[np.bool_], F64]:
    """Which pixels (M²,) of the plane see a ball on its axis, and the points (M², 3) seen; behind it is a wall at z = 3."""
    b = DIRECTIONS[:, 2] * centre
    square = b**2 - centre**2 + radius**2
    hit = square > 0
    t = np.where(hit, b - np.sqrt(np.where(hit, square, 0)), 3 / DIRECTIONS[:, 2])
    return hit, DIRECTIONS * t[:, None]


def test_h7_an_approaching_ball_is_seen_to_approach() -> None:
    """Larger by 18 %: cracks lose a part of the change; its sign is right, its size between 0.3 and 1.3 of what it is."""
    far, near = 1.5, 1.5 / 1.18
    hit, points = ball(far)
    drawn = drawn_on_plane(points + np.where(hit[:, None], [0, 0, near - far], 0))
    light = np.where(hit, 1.0, 0.1)
    now, exact = (np.sum(weights().ravel() * np.where(mask, 1.0, 0.1)) for mask in (hit, ball(near)[0]))
    estimated = np.sum(weights() * light[drawn.source])
    assert 0.3 <= (estimated - now) / (exact - now) <= 1.3


def test_h8_what_appears_behind_a_receding_ball_is_taken_from_the_background() -> None:
    """Filling holes by the deepest neighbour is no worse than by the nearest known pixel."""
    near, far = 1.0, 1.25
    hit, points = ball(near)
    drawn = drawn_on_plane(points + np.where(hit[:, None], [0, 0, far - near], 0))
    light = np.where(hit, 1.0, 0.1)
    exact = np.sum(weights().ravel() * np.where(ball(far)[0], 1.0, 0.1))
    rows, columns = np.nonzero(drawn.holes)
    known = np.argwhere(~drawn.holes)
    nearest = known[((known[None] - np.stack([rows, columns], 1)[:, None]) ** 2).sum(axis=2).argmin(axis=1)]
    other = drawn.source.copy()
    other[rows, columns] = drawn.source[tuple(nearest.T)]
    errors = [abs(np.sum(weights() * light[source]) / exact - 1) for source in (drawn.source, other)]
    assert len(rows) > 20
    assert errors[0] <= errors[1]


def test_a9_taylor_order_in_space_and_time() -> None:
    """A lamp over a plane moves linearly: the error of value + gradients + trends falls with the square of the offsets."""
    up, velocity = np.array([0.0, 0, 1]), np.array([0.02, 0.01, 0.005])
    h = 1e-4

    def at(p: F64, n: F64, t: float) -> float:
        return lamp(p - velocity * t, n / np.linalg.norm(n))

    def gradients(t: float) -> tuple[float, F64, F64]:
        axes = np.eye(3) * h
        translation = np.array([(at(a, up, t) - at(-a, up, t)) / (2 * h) for a in axes])
        rotation = np.array([(at(0 * a, up + np.cross(a, up), t) - at(0 * a, up - np.cross(a, up), t)) / (2 * h) for a in axes])
        return at(np.zeros(3), up, t), translation, rotation

    (e0, t0, r0), (e1, t1, r1) = gradients(0.0), gradients(h)
    three = np.ones(3)[:, None]
    record = Records(np.zeros((1, 3)), up[None], np.ones(1), np.full((1, 3), e0), (three * t0)[None], (three * r0)[None])
    later = Records(np.zeros((1, 3)), up[None], np.ones(1), np.full((1, 3), e1), (three * t1)[None], (three * r1)[None])
    trends = Trends.between(record, later, np.full(1, h))
    sites = Sites(record.position, record.normal, record.normal)
    one = np.ones(1, np.int64)
    timed = Timed.of(record, trends, sites, 0 * one, 0, 20 * one, 0 * one, 0 * one)
    errors = []
    for scale in (8.0, 4.0, 2.0, 1.0):
        p = np.array([0.02, -0.015, 0.0]) * scale
        n = up + np.array([0.02, 0.01, 0.0]) * scale
        n /= np.linalg.norm(n)
        value, _ = gather(p[None], n[None], timed.at(int(scale)), 1.0)
        errors.append(abs(value[0, 0] - at(p, n, int(scale))))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders >= 1.9).all(), (errors, orders)
