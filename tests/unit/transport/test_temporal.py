"""Parts of temporal caching by themselves: motion, anchors, coverage, trends, the overlay."""

from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import room_2
from numpy.typing import NDArray
from temporal_rooms import room

from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas, gather
from renderers.transport.caching.weights import WEIGHTS, weight
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal.anchors import anchors, carried
from renderers.transport.temporal.coverage import coverage, needed
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.overlay import overlay
from renderers.transport.temporal.records import Timed, succeeded
from renderers.transport.temporal.trends import Trends
from renderers.transport.temporal.updating import touches

F64 = NDArray[np.float64]


def records_at(position: F64, normal: F64, radius: float = 1.0) -> Records:
    n = len(position)
    zero = np.zeros((n, 3, 3))
    return Records(position, normal, np.full(n, radius), np.ones((n, 3)), zero, zero)


def timed_at(irradiance: F64, born: int, life: int, trends: Trends | None = None) -> Timed:
    n = len(irradiance)
    zero, three, none = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros(n, np.int64)
    records = Records(three, three, np.ones(n), irradiance, zero, zero)
    chosen = Trends.none(n) if trends is None else trends
    return Timed.of(records, chosen, Sites(three, three, three), np.arange(n), born, none + life, none, none)


def test_motion_finds_what_moved_and_where() -> None:
    scene = room(cube=lambda t: np.stack([0.1 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1))
    motion = motion_between(scene.world(0), scene.world(1))
    cube = motion.before.instance == motion.before.instance.max()
    assert motion.same_topology
    assert not any((motion.still, motion.lights, motion.materials))
    np.testing.assert_array_equal(motion.moved, cube)
    low, high = motion.boxes[:, 0].min(axis=0), motion.boxes[:, 1].max(axis=0)
    size = (high - low) / motion.before.scale
    np.testing.assert_allclose(size, [0.9, 0.8, 0.8], atol=1e-3)


def test_lamps_and_cameras_in_motion() -> None:
    lamp = room(lamp=lambda t: np.stack([0.1 * t, 0 * t, 2.5 + 0 * t], 1))
    assert motion_between(lamp.world(0), lamp.world(1)).lights
    brighter = room(intensity=lambda t: 5 + t)
    assert motion_between(brighter.world(0), brighter.world(1)).lights
    camera = room(camera=lambda t: np.stack([0.1 * t, -1.9 + 0 * t, 1.5 + 0 * t], 1))
    assert motion_between(camera.world(0), camera.world(1)).still


def test_segments_that_cross_boxes() -> None:
    rng = np.random.default_rng(0)
    low = rng.uniform(-1, 0.5, (3, 3))
    boxes = np.stack([low, low + rng.uniform(0.1, 0.6, (3, 3))], axis=1).astype(np.float32)
    origin, direction = rng.uniform(-1, 1, (300, 3)), rng.normal(size=(300, 3))
    out = np.array([touches(*ray, 0.7, boxes, 0, 1) for ray in zip(origin, direction, strict=True)])
    along = origin[:, None] + direction[:, None] * np.linspace(0, 0.7, 4001)[None, :, None]
    inside = ((along[:, :, None] >= boxes[:, 0]) & (along[:, :, None] <= boxes[:, 1])).all(axis=3).any(axis=(1, 2))
    # a corner may be cut between two of the 4001 points, never the other way round
    assert (out | ~inside).all()
    assert np.mean(out != inside) < 0.01
    x = np.array([1.0, 0, 0])
    assert not touches(np.array([0.0, 5, 0]), x, 9.0, boxes, 0, 1)
    low, high = boxes[0]
    for side, inside in ((low + 1e-6, True), (high - 1e-6, True), (low - 1e-6, False), (high + 1e-6, False)):  # along a face
        assert touches(np.array([low[0] - 1, side[1], side[2]]), x, 9.0, boxes, 0, 3) == inside
    assert not touches(np.array([low[0] - 1, *(low[1:] + 1e-6)]), x, 0.5, boxes, 0, 3)


def test_anchors_hold_places_on_their_surface_alone() -> None:
    scene = room(cube=lambda t: np.stack([0.3 + 0 * t, 0.4 + 0 * t, 0.45 + 0.01 * t], 1))
    worlds = [scene.world(k) for k in (0, 1)]
    top = (np.array([[0.3, 0.4, 0.85], [0.0, -1.0, 0.0]]) - worlds[0].centre) * worlds[0].scale
    up = np.array([[0.0, 0, 1], [0, 0, 1]])
    for side in (1, -1):  # of the geometric normal
        sites = Sites(top, up, side * up)
        np.testing.assert_array_equal(anchors(worlds[0], sites).held, [True, True])
        # the cube has risen above its place; the floor stays
        np.testing.assert_array_equal(anchors(worlds[1], sites).held, [False, True])


def test_places_go_where_their_triangles_go() -> None:
    from renderers import load_scene

    scene = load_scene("cube-in-a-box")
    before, after = scene.world(10), scene.world(30)
    gbuffer = cast_gbuffer(before, (24, 18))
    rows = np.flatnonzero(gbuffer.triangle.ravel() >= 12)
    position, normal = (a.reshape(-1, 3)[rows].astype(np.float64) for a in (gbuffer.position, gbuffer.normal))
    sites = Sites(position, normal, before.normals_of(gbuffer.triangle.ravel()[rows]))
    found = anchors(before, sites)
    assert found.held.all()
    rotation, shift = carried(before, after, found)
    np.testing.assert_allclose(rotation @ rotation.transpose(0, 2, 1), np.broadcast_to(np.eye(3), rotation.shape), atol=1e-6)
    moved = Sites(sites.position + shift, *(np.einsum("nij,nj->ni", rotation, a) for a in sites[1:]))
    again = anchors(after, moved)
    assert again.held.all()
    np.testing.assert_array_equal(again.triangle, found.triangle)


def test_a16_coverage_counts_the_pixels_of_each_zone() -> None:
    gbuffer = cast_gbuffer(room_2().world(), (24, 24))
    canvas = Canvas.of(gbuffer, dtype=np.float64)
    some = np.arange(0, len(canvas), 37)
    records = records_at(canvas.position[some], canvas.normal[some], 0.5)
    far = records_at(np.full((1, 3), 9.0), np.array([[0.0, 0, 1]]))
    counts = coverage(canvas, Records.joined([records, far]), 0.4)
    distance = np.linalg.norm(canvas.position[None] - records.position[:, None], axis=2) / 0.5
    bend = np.linalg.norm(canvas.normal[None] - records.normal[:, None], axis=2) / np.sqrt(2)
    inside = np.array(
        [[weight(WEIGHTS["ward"], d, b, 0.4) > 0 for d, b in zip(*rows, strict=True)] for rows in zip(distance, bend, strict=True)]
    )
    np.testing.assert_array_equal(counts[:-1], inside.sum(axis=1))
    assert counts[-1] == 0


@pytest.mark.parametrize("others", [1, 2, 3])
def test_records_are_needed_where_too_few_others_reach_a_pixel(others: int) -> None:
    """Seven at one place: sure ones count first, of the rest as many as are missing, and one that isn't needed doesn't count."""
    canvas = Canvas.of(cast_gbuffer(room_2().world(), (24, 24)))
    same = records_at(
        np.repeat(canvas.position[:1], 7, axis=0).astype(float), np.repeat(canvas.normal[:1], 7, axis=0).astype(float)
    )
    for sure in (0, 1, 4):
        found = needed(canvas, same, np.arange(7) >= 7 - sure, 0.4, others=others)
        missing = max(others - sure, 0)
        assert found[: 7 - sure].tolist() == [True] * missing + [False] * (7 - sure - missing)


@pytest.mark.parametrize("mode", ["none", "extrapolated", "interpolated"])
def test_a11_errors_over_a_life_stay_within_their_bounds(mode: str) -> None:
    """Lag d of life L: frozen d·max|E'|, extrapolated ½d(d-1)·max|E''|, interpolated ½d(L-d)·max|E''|; sines of many speeds."""
    speed, phase = np.meshgrid(np.linspace(0.01, 0.3, 12), np.linspace(0, 6, 20))

    def light(t: float) -> F64:
        return np.repeat((2 + np.sin(speed * t + phase)).reshape(-1, 1), 3, axis=1)

    life = 20
    now = timed_at(light(0), 0, life)
    later = {
        "none": now.records,
        "extrapolated": timed_at(light(1), 1, 1).records,
        "interpolated": timed_at(light(life), life, 1).records,
    }
    span = np.full(len(now), 1.0 if mode == "extrapolated" else life)
    trends = Trends.none(len(now)) if mode == "none" else Trends.between(now.records, later[mode], span)
    timed = now.with_trends(slice(None), trends)
    first, second = speed.ravel(), speed.ravel() ** 2
    for d in range(life):
        error = np.abs(timed.at(d).irradiance - light(d))[:, 0]
        bound = {"none": d * first, "extrapolated": d * (d - 1) / 2 * second, "interpolated": d * (life - d) / 2 * second}[mode]
        assert (error <= bound + 1e-12).all()


def turn_about(axis: int, angle: float) -> F64:
    """Rotation (3, 3) about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    plane = [k for k in range(3) if k != axis]
    found = np.eye(3)
    found[np.ix_(plane, plane)] = [[c, -s], [s, c]]
    return found


def coloured(seed: int, count: int = 4) -> tuple[Timed, F64]:
    """Places near the origin with normals near z and random light, gradients and trends; their positions."""
    rng = np.random.default_rng(seed)
    position, normal = rng.normal(size=(count, 3)) * 0.1, rng.normal(size=(count, 3)) * 0.1 + [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    light, *gradients = (rng.uniform(-0.3, 0.3, (count, *shape)) for shape in ((3,), (3, 3), (3, 3)))
    records = Records(position, normal, np.ones(count), light + 3, *gradients)
    trends = Trends(*(rng.uniform(-0.1, 0.1, (count, *shape)) for shape in ((3,), (3, 3), (3, 3))))
    none, slanted = np.zeros(count, np.int64), np.roll(normal, 1, axis=0)
    return Timed.of(records, trends, Sites(position, normal, slanted), np.arange(count), 0, none + 9, none, none), position


def test_light_goes_with_places_that_turn_and_move() -> None:
    """Records and points turned and moved alike, twice: what records say of the points stays, now and later. So do axes and
    normals."""
    timed, position = coloured(0)
    rng = np.random.default_rng(1)
    points, normals = position + rng.normal(size=(4, 3)) * 0.05, timed.records.normal
    turn, index, moved = np.eye(3), np.arange(4), timed
    place = position
    for axis, angle, shift in ((0, 0.4, [0.1, 0.2, 0.3]), (1, -0.7, [-0.4, 0.0, 0.2])):
        one = turn_about(axis, angle)
        there = place @ one.T + shift
        moved = moved.carried(index, np.tile(one, (4, 1, 1)), there - place)
        points, normals, turn, place = points @ one.T + shift, normals @ one.T, one @ turn, there
    for frame in (0, 5):
        here, _ = gather(position + (points - place) @ turn, timed.records.normal, timed.at(frame), 0.9)
        there, _ = gather(points, normals, moved.at(frame), 0.9)
        np.testing.assert_allclose(there, here, rtol=1e-9)
    np.testing.assert_allclose(moved.sites.geometric, timed.sites.geometric @ turn.T, atol=1e-12)
    np.testing.assert_allclose(moved.sites.normal, moved.records.normal, atol=1e-12)
    np.testing.assert_allclose(moved.tangents, timed.tangents @ turn.T, atol=1e-12)
    some = timed.carried(index[:1], np.tile(turn_about(0, 0.4), (1, 1, 1)), np.ones((1, 3)))
    np.testing.assert_array_equal(some.records.translation[1:], timed.records.translation[1:])


def test_light_that_turns_with_its_place_has_no_trend_but_its_own() -> None:
    """A successor with the light of the record before it, which turned with its place before it was made, and again until its
    successor came: gradients are compared in the axes of the place."""
    first, _ = coloured(3)
    index, one, two = np.arange(4), np.tile(turn_about(0, 0.9), (4, 1, 1)), np.tile(turn_about(2, 0.5), (4, 1, 1))
    old = first.carried(index, one, np.zeros((4, 3)))
    new = replace(old.carried(index, two, np.zeros((4, 3))), born=np.full(4, 9), life=np.full(4, 1))
    brighter = replace(new, records=replace(new.records, irradiance=new.records.irradiance + 0.9))
    found, waits = succeeded(old, np.ones(4, bool), brighter, 9)
    assert not waits.any()
    np.testing.assert_allclose(found.trends.irradiance, 0.1, rtol=1e-9)
    np.testing.assert_allclose(found.trends.translation, 0, atol=1e-12)
    np.testing.assert_allclose(found.trends.rotation, 0, atol=1e-12)


def test_trends_are_scaled_channel_by_channel_and_shrunk_in_their_translation() -> None:
    rng = np.random.default_rng(5)
    shapes = ((2, 3), (2, 3, 3), (2, 3, 3), (2, 4, 3), (2, 2, 4, 3))
    trends = Trends(*(rng.normal(size=shape) for shape in shapes))
    factor = rng.random((2, 3))
    scaled = trends.scaled(factor)
    for name, channels in (
        ("irradiance", "kc"),
        ("translation", "kci"),
        ("rotation", "kci"),
        ("coefficients", "kic"),
        ("coefficient_gradients", "kdic"),
    ):
        column = getattr(trends, name)
        np.testing.assert_allclose(getattr(scaled, name), np.einsum(f"{channels},kc->{channels}", column, factor))
    shrunk = trends.shrunk(np.array([0.5, 1.0]))
    for name in ("irradiance", "translation", "rotation", "coefficients", "coefficient_gradients"):
        by = 0.5 if name in ("translation", "coefficient_gradients") else 1.0
        np.testing.assert_allclose(getattr(shrunk, name)[0], by * getattr(trends, name)[0])
        np.testing.assert_array_equal(getattr(shrunk, name)[1], getattr(trends, name)[1])


def test_h17_a_channel_never_goes_below_zero() -> None:
    trends = Trends(np.array([[-0.1, -0.4, 0.0]]), np.zeros((1, 3, 3)), np.zeros((1, 3, 3)))
    np.testing.assert_array_equal(timed_at(np.ones((1, 3)), 0, 9, trends).at(5).irradiance, [[0.5, 0, 1]])


def test_successors_are_found_by_place_and_missing_ones_leave_trends_alone() -> None:
    trends = Trends(np.full((4, 3), 0.5), np.zeros((4, 3, 3)), np.zeros((4, 3, 3)))
    old = timed_at(np.ones((4, 3)), 3, 5, trends)
    new = timed_at(np.full((4, 3), 3.0), 8, 1).rows([1, 3])
    waiting = np.array([True, True, True, False])
    result, waits = succeeded(old, waiting, new, 7)
    assert result.trends.irradiance[:, 0].tolist() == [0.5] * 4
    np.testing.assert_array_equal(waits, waiting)
    result, waits = succeeded(old, waiting, new, 8)
    np.testing.assert_allclose(result.trends.irradiance[:, 0], [0.5, 0.4, 0.5, 0.5])
    assert not waits.any()
    result, waits = succeeded(old, waiting, Timed.empty(), 8)
    assert result.trends.irradiance[:, 0].tolist() == [0.5] * 4
    assert not waits.any()


def test_overlay_draws_visible_records_in_the_colours_of_their_lives() -> None:
    world = room_2().world()
    gbuffer = cast_gbuffer(world, (32, 32))
    seen = np.array([(20, 7), (9, 25)])
    position = gbuffer.position[seen[:, 0], seen[:, 1]].astype(np.float64)
    hidden = world.camera.pose[:3, 3] + 9 * (position[:1] - world.camera.pose[:3, 3])
    behind = world.camera.pose[:3, 3] + world.camera.pose[:3, 2][None]
    timed = timed_at(np.ones((4, 3)), 0, 1)
    sites = Sites(np.concatenate([position, hidden, behind]), np.zeros((4, 3)), np.zeros((4, 3)))
    picture = overlay(
        [replace(timed, sites=sites, life=np.array([1, 20, 10, 10]))],
        20,
        world.camera,
        gbuffer.position,
        np.ones((32, 32, 3), np.float32),
    )
    assert picture[20, 7].tolist() == [1, 0, 0]
    assert picture[9, 25].tolist() == [0, 1, 0]
    assert (picture.reshape(-1, 3).max(axis=1) > 0.3).sum() == 2
