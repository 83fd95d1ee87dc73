"""Radiance records in time: rates, trends, places that turn, and frames of glossy scenes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from temporal_frames import (
    COARSE,
    MODES,
    SIZE,
    assert_any_number_of_threads,
    assert_beginnings_agree,
    assert_computed_once,
    bytes_of,
    frames_of,
    polar,
    sampled,
    total,
)  # fmt: skip
from temporal_rooms import floor, line, room, slow_cube, toy_box

from renderers import get_method, load_scene
from renderers.scene.model import GGX, Material, Phong, Scene
from renderers.transport.caching.glossy import reflected
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.hemispherical.rotation import rotate
from renderers.transport.sampling import frame as frame_of
from renderers.transport.temporal.lifespan import change_rate, dark_level
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.prediction import RayCast, Reprojection
from renderers.transport.temporal.records import Timed, succeeded
from renderers.transport.temporal.trends import Trends

F64 = NDArray[np.float64]
ORDER = 4
pytestmark = pytest.mark.usefixtures("software_device")


def polished(scene: Scene, *others: Material) -> Scene:
    """All surfaces glossy; others: materials in place of the first ones."""
    plain = [Phong(m.name, (0.3, 0.25, 0.2), (0.4,) * 3, 10.0) for m in scene.materials]
    return replace(scene, materials=(*others, *plain[len(others) :]))


def slow_glossy_cube() -> Scene:
    """A glossy room, and a glossy cube that slides along by 1 cm a frame."""
    return polished(slow_cube())


def carrying(coefficients: F64, gradients: F64 | None = None, radius: float = 1.0) -> Records:
    """Records at the origin, facing up, with coefficients (K, n², 3)."""
    count = len(coefficients)
    zero, three = np.zeros((count, 3, 3)), np.zeros((count, 3))
    slopes = np.zeros((count, 2, *coefficients.shape[1:])) if gradients is None else gradients
    up = np.tile([0.0, 0, 1], (count, 1))
    return Records(
        three, up, np.full(count, radius), three + 1, zero, zero, coefficients, slopes, tangents=np.stack(frame_of(up), axis=1)
    )  # fmt: skip


def timed(records: Records, born: int, life: int, trends: Trends | None = None) -> Timed:
    count, none = len(records), np.zeros(len(records), np.int64)
    sites = Sites(records.position, records.normal, records.normal)  # type: ignore[arg-type]
    chosen = Trends.none(count) if trends is None else trends
    return Timed.of(records, chosen, sites, np.arange(count), born, none + life, none, none)


def test_coefficients_that_scale_together_change_at_the_rate_of_the_light() -> None:
    light = np.random.default_rng(0).normal(size=(5, ORDER**2, 3))
    now = carrying(light)
    for factor in (0.5, 0.97, 1.02, 3.0):
        for together in (True, False):
            rate = change_rate(now, carrying(light * factor), dark_level(now), together)
            np.testing.assert_allclose(rate, abs(factor - 1), rtol=1e-9)


def test_a_single_coefficient_counts_by_its_share_of_the_function() -> None:
    """By norms: half of the coefficients that halve, a small one that changes sign, a tiny one that grows fifty times."""
    now = np.zeros((3, 4, 3))
    now[:, :, 0] = [[1.0, 0.8, 0.6, 0.02], [1.0, 0.8, 0.6, 0.02], [1.0, 0.8, 0.6, 1e-9]]
    later = now.copy()
    later[0, 1:] /= 2
    later[1, 3] *= -1
    later[2, 3] *= 50
    norm = np.sqrt(2.0004)
    expected = np.array([np.sqrt(0.4**2 + 0.3**2 + 0.01**2) / norm, 0.04 / norm, 49e-9 / np.sqrt(2.0)])
    first, last = carrying(now), carrying(later)
    np.testing.assert_allclose(change_rate(first, last, 1e-6, together=True), expected, rtol=1e-9)
    np.testing.assert_allclose(change_rate(first, last, 1e-6)[:2], [0.5, 2.0])


def test_black_radiance_has_a_floor() -> None:
    black, dim, lit = (carrying(np.full((1, 9, 3), value)) for value in (0.0, 1e-9, 0.5))
    least = dark_level(Records.joined([black, lit]))
    for together in (True, False):
        assert change_rate(black, black, least, together) == 0
        assert change_rate(black, lit, least, together) > 100
        assert change_rate(dim, black, least, together) < 1e-4


def waves(x: F64, y: F64, t: float) -> dict[str, F64]:
    """Coefficients (P, n², 3) that are sines of place and time, and their derivatives."""
    rng = np.random.default_rng(4)
    a, b, c, d = rng.uniform(-1, 1, (4, ORDER**2, 3))
    phase = a * x[:, None, None] + b * y[:, None, None] + c * t + d
    one, two = np.cos(phase), -np.sin(phase)
    return {
        "light": 2 + np.sin(phase),
        "slope": np.stack([a * one, b * one], axis=1),
        "rate": c * one,
        "mixed": np.stack([a * c * two, b * c * two], axis=1),
    }


def test_reflected_light_is_right_to_second_order_in_place_and_time() -> None:
    """Both offsets halve: the error falls to a quarter; without the trend of the coefficients by half alone."""
    here = waves(np.zeros(1), np.zeros(1), 0.0)
    trends = Trends(*(np.zeros((1, *shape)) for shape in ((3,), (3, 3), (3, 3))), here["rate"], here["mixed"])
    brdf = np.random.default_rng(5).uniform(0, 0.2, (1, 3, ORDER**2)).astype(np.float32)
    axes = frame_of(np.array([[0.0, 0, 1]]))
    errors: dict[bool, list[float]] = {True: [], False: []}
    for size in (0.4, 0.2, 0.1, 0.05):
        frames = size * 100
        for moves in (True, False):
            # a unit of time is 100 frames
            slow = Trends(*(column / 100 for column in (getattr(trends, name) for name in Trends.__dataclass_fields__)))
            record = timed(carrying(here["light"], here["slope"]), 0, 100, slow if moves else None)
            point = size * (0.6 * axes[0] - 0.8 * axes[1])
            canvas = Canvas(np.zeros(1, np.intp), 1, point, np.array([[0.0, 0, 1]]))
            found = reflected(canvas, record.at(round(frames)), lambda part: brdf, 1.0)
            exact = waves(np.array([0.6 * size]), np.array([-0.8 * size]), size)["light"]
            errors[moves].append(float(np.abs(found - np.einsum("pci,pic->pc", brdf, exact)).max()))
    orders = {moves: np.log2(np.array(found[:-1]) / found[1:]) for moves, found in errors.items()}
    # third-order terms at the largest offset
    assert np.all(np.abs(orders[True] - 2) < 0.4), orders
    assert np.all(np.abs(orders[False] - 1) < 0.4), orders


def test_interpolated_coefficients_reach_those_of_the_successor() -> None:
    rng = np.random.default_rng(6)
    first, last = (carrying(rng.normal(size=(3, 9, 3)), rng.normal(size=(3, 2, 9, 3))) for _ in range(2))
    old, new = timed(first, 3, 5), timed(last, 8, 1).rows([0, 2])
    joined, waits = succeeded(old, np.ones(3, bool), new, 8)
    assert not waits.any()
    for name in ("coefficients", "coefficient_gradients"):
        found, start, end = (getattr(records, name) for records in (joined.at(8), first, last))
        np.testing.assert_allclose(found[[0, 2]], end[[0, 2]], atol=1e-6)  # float32
        np.testing.assert_allclose(found[1], start[1], atol=1e-6)  # no successor, no trend
        np.testing.assert_allclose(getattr(joined.at(5), name)[0], start[0] + 0.4 * (end[0] - start[0]), atol=1e-6)


def test_a_place_that_turns_takes_its_radiance_along() -> None:
    """Records and pixels turned and moved alike: what is reflected stays, though frames of pixels aren't the turned ones."""
    rng = np.random.default_rng(7)
    records = carrying(rng.normal(size=(6, ORDER**2, 3)), rng.normal(size=(6, 2, ORDER**2, 3)))
    normal = rng.normal(size=(6, 3)) * 0.2 + [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    position = rng.normal(size=(6, 3)) * [0.2, 0.2, 0.02]
    records = replace(records, position=position, normal=normal, tangents=np.stack(frame_of(normal), axis=1))
    axis, angle = np.array([0.36, 0.48, 0.8]), 1.9
    cross = np.cross(np.eye(3), -axis)
    turn, shift = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross, np.array([0.3, -0.5, 0.7])
    carried = timed(records, 0, 9).carried(np.arange(6), np.tile(turn, (6, 1, 1)), position @ turn.T + shift - position)
    points = np.concatenate([position, np.zeros((1, 3))])
    normals = np.concatenate([normal, [[0.0, 0, 1]]])
    brdf = rng.normal(size=(7, 3, ORDER**2))
    axes, others = (np.stack([*frame_of(n), n], axis=1) for n in (normals, normals @ turn.T))
    turned = rotate(brdf.transpose(0, 2, 1), others @ (axes @ turn.T).transpose(0, 2, 1)).transpose(0, 2, 1)
    found = [
        reflected(Canvas(np.arange(7), 7, p, n), kept, lambda part, c=c: c[part].astype(np.float32), 1.0)  # type: ignore[misc]
        for p, n, c, kept in ((points, normals, brdf, records), (points @ turn.T + shift, normals @ turn.T, turned, carried.at(4)))
    ]
    assert np.abs(found[0]).max() > 1
    # float32, and tables of turns
    np.testing.assert_allclose(found[1], found[0], atol=2e-3 * np.abs(found[0]).max())


def places(scene: Scene, count: int) -> Sites:
    """On the floor of the box, at rest."""
    return floor(scene.world(0), np.random.default_rng(1).uniform(-0.9, 0.9, (count, 2)))


def test_recasting_foresees_the_coefficients_of_the_next_frame() -> None:
    scene = toy_box(light_speed=0.0)
    motion, here = motion_between(scene.world(4), scene.world(5)), places(scene, 12)
    sampler = polar(motion.before, 1024, order=ORDER)
    now, later = sampled(sampler, here, RayCast(motion, sampler, ReflectedDirectLight(motion.after)))
    exact, _ = sampled(polar(motion.after, 1024, order=ORDER), here)
    for name in ("coefficients", "coefficient_gradients"):
        assert np.abs(getattr(now, name) - getattr(exact, name)).max() > 1e-3
        np.testing.assert_allclose(getattr(later, name), getattr(exact, name), atol=1e-9)


def test_reprojection_foresees_most_of_the_change_in_cells_of_equal_solid_angle() -> None:
    """Relative error of the coefficients: at most half of that of light taken for constant; none where nothing moves."""
    scene = toy_box(light_speed=0.0, speed=2.0)
    motion, here = motion_between(scene.world(4), scene.world(5)), places(scene, 24)
    sampler = polar(motion.before, order=ORDER)
    now, later = sampled(sampler, here, Reprojection(motion, sampler, ReflectedDirectLight(motion.after), 4))
    exact, _ = sampled(polar(motion.after, order=ORDER), here)
    assert now.coefficients is not None
    assert later.coefficients is not None
    assert exact.coefficients is not None
    size = np.linalg.norm(exact.coefficients, axis=(1, 2))
    error, constant = (np.linalg.norm(x - exact.coefficients, axis=(1, 2)) / size for x in (later.coefficients, now.coefficients))
    assert constant.mean() > 0.005
    assert error.mean() <= 0.5 * constant.mean()
    still = motion_between(motion.before, motion.before)
    same, again = sampled(sampler, here, Reprojection(still, sampler, ReflectedDirectLight(still.after), 4))
    np.testing.assert_array_equal(same.coefficients, again.coefficients)  # type: ignore[arg-type]


@pytest.mark.parametrize("others", [(), (GGX("sharp", (0.6,) * 3, 1.0, 0.1), GGX("dull", (0.5, 0.4, 0.3), 0.2, 0.7))])
def test_cache_per_frame_is_radiance_cache_splatting(others: tuple[Material, ...]) -> None:
    """Records of radiance, lobes that are traced, and pixels of both kinds of records."""
    rcs, scene = get_method("rcs"), polished(slow_cube(), *others) if others else load_scene("bouncing-spheres")
    for k, frame in enumerate(frames_of(scene, 2, cache="per-frame")):
        plain = rcs.render(scene, rcs.Settings(placement="hessian-bounded", **COARSE), size=SIZE, frame=k)
        assert bytes_of(frame) == bytes_of(plain)
        assert plain.counters["radiance_records"] > 10
        shared = plain.counters.keys() - {"splats", "splat_tests"}
        assert {name: frame.counters[name] for name in shared} == {name: plain.counters[name] for name in shared}
        assert frame.notes == plain.notes
        assert bool(frame.notes) == bool(others)


def test_a_still_glossy_scene_is_computed_once_and_gives_the_same_bytes() -> None:
    assert assert_computed_once(load_scene("cornell-glossy")).counters["radiance_records"] > 10


@MODES
def test_a_glossy_frame_does_not_depend_on_the_end_of_its_range(mode: str) -> None:
    assert_beginnings_agree(slow_glossy_cube(), 6, 3, (1, 3), gradients_in_time=mode, delta_max=4)


def test_glossy_frames_have_the_same_bytes_at_any_thread_count() -> None:
    assert_any_number_of_threads(slow_glossy_cube())


@pytest.mark.parametrize("follow", [True, False])
def test_few_records_keep_the_light_of_a_moving_cube_and_its_glossy_room(follow: bool) -> None:
    """Against records of each frame: less than half as many, and pictures within what interpolation leaves open."""
    scene = slow_glossy_cube()
    kept, plain = frames_of(scene, 12, follow=follow), frames_of(scene, 12, cache="per-frame")
    made = [total(frames, "radiance_records") for frames in (kept, plain)]
    assert made[0] < 0.5 * made[1]
    last, exact = kept[-1].layers["indirect"], plain[-1].layers["indirect"]
    # at glossy_a = 0.4 two sets of records differ by that much in a frame without any history
    assert np.abs(last - exact).mean() <= 0.15 * exact.mean()
    assert all(f.counters["pixels_missed"] == 0 for f in kept)


def test_a_moving_lamp_over_glossy_surfaces() -> None:
    """Coefficients that scale and turn with the lamp; norms alone ask for fewer records than single coefficients do."""
    scene = polished(room(lamp=line((-0.4, 0, 2.5), (0.02, 0, 0))))
    plain = frames_of(scene, 10, cache="per-frame")
    made = {}
    for rate in ("norm", "coefficients"):
        frames = frames_of(scene, 10, glossy_rate=rate)
        made[rate] = total(frames, "radiance_records")
        exact = plain[-1].layers["indirect"]
        assert np.abs(frames[-1].layers["indirect"] - exact).mean() <= 0.15 * exact.mean()
    assert made["norm"] < made["coefficients"] <= 1.05 * total(plain, "radiance_records")
