"""Temporal caching where it is hard: sudden changes, things that come and go, ends of ranges, long runs, cuts."""

from collections import Counter

import numpy as np
import pytest
from caching_rooms import EYE_2, FORWARD_2
from numpy.typing import NDArray
from temporal_rooms import room

from renderers import Frame, get_method, load_scene
from renderers.methods.trc import TemporalRadianceCaching, TrcSettings
from renderers.scene.model import Scene
from renderers.transport.temporal.anchors import anchors
from renderers.transport.temporal.cache import Stage, TemporalCache, View
from renderers.transport.temporal.coverage import coverage
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.records import Timed

F64 = NDArray[np.float64]
METHOD = TemporalRadianceCaching()
SIZE = (24, 24)
COARSE = {"rays": 128, "a": 0.4}
MODES = pytest.mark.parametrize("mode", ["none", "extrapolated", "interpolated"])


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe (LLVM 15.0.6, 256 bits)")


def frames_of(scene: Scene, count: int, first: int = 0, **settings: object) -> list[Frame]:
    chosen = TrcSettings(**{**COARSE, **settings})  # type: ignore[arg-type]
    return list(METHOD.render_frames(scene, chosen, size=SIZE, frames=(first, first + count - 1)))


def indirect(frames: list[Frame]) -> F64:
    """Mean indirect light of each frame."""
    return np.array([f.layers["indirect"].mean(dtype=np.float64) for f in frames])


def exact(scene: Scene, count: int) -> list[Frame]:
    """Caches of each frame by itself."""
    rcs = get_method("rcs")
    return list(rcs.render_frames(scene, rcs.Settings(placement="hessian-bounded", **COARSE), size=SIZE, frames=(0, count - 1)))


def stepped(at: int, before: float, after: float) -> Scene:
    """The lamp changes its intensity between frames at - 1 and at, once."""
    return room(intensity=lambda t: np.where(t < at, before, after), frames=20)


@MODES
@pytest.mark.parametrize(("before", "after"), [(4.0, 6.0), (8.0, 0.0), (0.0, 8.0)])
def test_h4_h5_a_step_of_light_is_over_after_a_life(mode: str, before: float, after: float) -> None:
    """Off, on, or half as much again. Frozen records lag and interpolated ones start early, never by more than the step; a life
    later, and a life before, the picture is that of the light as it is."""
    longest, at = 4, 8
    frames = indirect(frames_of(stepped(at, before, after), at + longest + 2, gradients_in_time=mode, delta_max=longest))
    level = {light: indirect(frames_of(stepped(99, light, light), 1))[0] for light in (before, after)}
    # where records lie depends on what they saw, hence the level only to a few per cent
    tolerance = 0.1 * max(level.values())
    assert np.abs(frames[: at - longest] - level[before]).max() <= tolerance
    assert np.abs(frames[at + longest - 1 :] - level[after]).max() <= tolerance
    assert frames.min() >= min(level.values()) - tolerance
    # the pair of frames that straddles the step extrapolates it; its records live for one frame, so nothing overshoots
    assert frames.max() <= max(level.values()) + tolerance


def test_a_strobe_falls_back_to_the_cost_of_per_frame_caching() -> None:
    """Light on and off in turn: nothing can be kept, and soon nothing is foreseen."""
    scene = room(intensity=lambda t: np.where(t % 2 == 0, 8.0, 2.0), frames=40)
    frames = frames_of(scene, 16)
    truth = indirect(exact(scene, 16))
    assert np.abs(indirect(frames) - truth).max() <= 0.05 * truth.max()
    late = frames[8:]
    predicted = sum(f.counters["predictions"] for f in late)
    assert predicted <= 0.25 * sum(f.counters["records"] for f in late)
    unguarded = frames_of(scene, 16, guard=False)[8:]
    assert predicted < 0.3 * sum(f.counters["predictions"] for f in unguarded)


@MODES
def test_an_object_that_jumps_leaves_no_ghost_longer_than_a_life(mode: str) -> None:
    at, longest = 6, 4
    path = lambda t: np.stack([np.where(t < at, -0.8, 0.9), 0.4 + 0 * t, 0.45 + 0 * t], 1)  # noqa: E731
    scene = room(cube=path, frames=20)
    count = at + longest + 1
    frames, truth = frames_of(scene, count, gradients_in_time=mode, delta_max=longest), exact(scene, count)
    error = [np.abs(f.layers["indirect"] - g.layers["indirect"]).mean() for f, g in zip(frames, truth, strict=True)]
    mean = np.mean(truth[-1].layers["indirect"])
    assert error[0] == 0
    # two caches of other records differ by their interpolation errors
    assert error[-1] < 0.15 * mean
    assert all(f.counters["pixels_missed"] == 0 for f in frames)
    assert frames[at].counters["records_new"] > 0


def test_an_object_that_enters_from_outside_and_a_camera_cut() -> None:
    enters = room(cube=lambda t: np.stack([-9 + 0.8 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1), frames=20)
    cut = room(camera=lambda t: np.where((t < 3)[:, None], [[-0.2, -1.95, 1.5]], [[1.2, 0.2, 2.2]]), frames=20)
    for scene in (enters, cut):
        frames = frames_of(scene, 14 if scene is enters else 5, delta_max=3)
        assert all(f.counters["pixels_missed"] == 0 for f in frames)
    assert [f.counters["records_new"] > 0 for f in frames] == [True, False, False, True, False]
    # what the camera no longer sees is gone a life later
    assert frames_of(cut, 8, delta_max=3)[-1].counters["records_alive"] < frames[3].counters["records_alive"]


@MODES
def test_h20_one_frame_and_the_last_frames_of_an_animation(mode: str) -> None:
    scene = room(cube=lambda t: np.stack([0.02 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1), frames=5)
    single = METHOD.render(scene, TrcSettings(**COARSE, gradients_in_time=mode), size=SIZE, frame=5)  # type: ignore[arg-type]
    assert np.isfinite(single.layers["beauty"]).all()
    assert all(np.isfinite(f.layers["beauty"]).all() for f in frames_of(scene, 3, first=3, gradients_in_time=mode))
    # the animation holds still after its last key
    beyond = frames_of(scene, 3, first=5, gradients_in_time=mode)
    assert beyond[-1].counters["records"] == 0
    assert beyond[1].layers["beauty"].tobytes() == beyond[2].layers["beauty"].tobytes()


def caches_of(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, count: int, **settings: object
) -> list[tuple[Timed, Stage, list[View]]]:
    """What lives after each frame, and what the frame was computed with."""
    found: list[tuple[Timed, Stage, list[View]]] = []
    step = TemporalCache.step

    def watched(cache: TemporalCache, stage: Stage, views: list[View], counters: Counter[str]) -> Timed:
        renewed = step(cache, stage, views, counters)
        found.append((cache.live, stage, views))
        return renewed

    monkeypatch.setattr(TemporalCache, "step", watched)
    frames_of(scene, count, **settings)
    return found


@pytest.mark.parametrize("follow", [True, False])
def test_h11_a26_little_that_no_pixel_needs_stays_behind_a_moving_object(monkeypatch: pytest.MonkeyPatch, follow: bool) -> None:
    """Of the records alive at the end 5 % at most reach no pixel."""
    scene = room(cube=lambda t: np.stack([-1.2 + 0.05 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1), frames=40)
    live, stage, views = caches_of(monkeypatch, scene, 36, delta_max=4, follow=follow)[-1]
    assert len(live) > 50
    assert np.mean(reached(live, stage, views) == 0) <= 0.05


def reached(live: Timed, stage: Stage, views: list[View]) -> NDArray[np.int64]:
    """Pixels of each record's zone, (K,)."""
    counts = [coverage(view.canvas, live.records, stage.placement.a, stage.placement.weight) for view in views]
    return np.sum(counts, axis=0)


def test_h10_records_that_an_object_moves_over_are_gone_a_life_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cube stands in the floor; places inside it that reach no pixel for a whole life aren't alive after it."""
    longest = 4
    path = lambda t: np.stack([-0.9 + 0.08 * t, 0.4 + 0 * t, 0.35 + 0 * t], 1)  # noqa: E731
    frames = caches_of(monkeypatch, room(cube=path, frames=40), 20, delta_max=longest)
    useless = [set(live.place[reached(live, stage, views) == 0].tolist()) for live, stage, views in frames]
    inside = 0
    for t in range(len(frames) - longest):
        gone = set.intersection(*useless[t : t + longest])
        assert not gone & set(frames[t + longest][0].place.tolist())
        live, stage, _ = frames[t]
        world = stage.sampler.world
        away = np.abs(live.sites.position / world.scale + world.centre - path(np.array([float(t)]))[0]).max(axis=1)
        inside += len(useless[t] & set(live.place[away < 0.4].tolist()))
    assert inside > 0


def test_records_on_a_moving_cube_go_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """They keep their triangles while they live, whatever face they lie on; as published, those on faces that leave lose them.

    Lives don't depend on light (a_t = 10), so that all records of frame 0 still live, and a is small, so that there are many.
    """
    scene = load_scene("cube-in-a-box")
    kept = {}
    for follow in (True, False):
        frames = caches_of(monkeypatch, scene, 6, delta_max=8, follow=follow, stagger=False, a=0.05, a_t=10.0)
        (first, stage, _), (last, later, _) = frames[0], frames[-1]
        cube = first.rows(anchors(stage.sampler.world, first.sites).triangle >= 12)
        cube = cube.rows((cube.last >= 5) & np.isin(cube.place, last.place))
        same = last.rows(np.isin(last.place, cube.place))
        assert len(cube) > 20
        assert len(set(anchors(stage.sampler.world, cube.sites).triangle // 2)) >= 2  # faces
        found = anchors(later.sampler.world, same.sites)
        kept[follow] = float(np.mean(found.held & (found.triangle == anchors(stage.sampler.world, cube.sites).triangle)))
        np.testing.assert_allclose(np.linalg.norm(same.sites.normal, axis=1), 1, rtol=1e-9)
    assert kept[True] == 1
    assert kept[False] < 1


def test_c8_lives_are_short_where_light_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Near a cube that passes by they are at most 0.7 times as long as far from it, where they are nearly as long as may be."""
    path = lambda t: np.stack([-1.2 + 0.06 * t, 0.9 + 0 * t, 0.45 + 0 * t], 1)  # noqa: E731
    live, stage, _ = caches_of(monkeypatch, room(cube=path, frames=20), 8, stagger=False, lifespan="rate", a=0.2)[-1]
    world = stage.sampler.world
    away = np.linalg.norm(live.sites.position / world.scale + world.centre - path(np.array([7.0]))[0], axis=1)
    near, far = live.life[away < 1.2], live.life[away > 2.5]
    assert min(len(near), len(far)) > 10
    assert near.mean() < 0.7 * far.mean()


def test_places_that_add_up_end_where_others_stand_in_for_them() -> None:
    """A camera comes near and goes back, a cube creeps. No pixel goes without a record, and beginnings stay what they are."""
    scene = room(
        cube=lambda t: np.stack([0.3 + 0.002 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1),
        camera=lambda t: EYE_2 + np.outer(1.2 * np.sin(np.pi * np.minimum(t / 24, 1)), FORWARD_2),
        frames=30,
    )
    few = {"delta_max": 4, "a": 0.1, "rays": 64}
    ended, kept = (frames_of(scene, 30, guard=guard, **few) for guard in (True, False))
    assert sum(frame.counters["pixels_missed"] for frame in ended) == 0
    assert ended[-1].counters["records_alive"] < 0.9 * kept[-1].counters["records_alive"]
    for whole, alone in zip(ended, frames_of(scene, 20, **few), strict=False):
        assert whole.layers["indirect"].tobytes() == alone.layers["indirect"].tobytes()


def test_h16_lives_that_no_rate_can_tell_are_noted() -> None:
    for settings, said in (({"delta_max": 25}, 0), ({"delta_max": 26}, 1), ({"delta_max": 26, "cache": "static"}, 0)):
        assert len(frames_of(room(), 1, **settings)[0].notes) == said


def test_h12_staggered_expiry_has_no_pulses() -> None:
    scene = room(cube=lambda t: np.stack([0.0005 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1), frames=40)
    peaks = {}
    for stagger in (True, False):
        renewed = np.array([f.counters["records_renewed"] for f in frames_of(scene, 22, delta_max=8, stagger=stagger)][1:])
        peaks[stagger] = renewed.max() / renewed.mean()
    assert peaks[False] > 3
    assert peaks[True] < 2.5


def test_a_scaled_away_object_changes_the_topology_and_is_survived() -> None:
    """An instance scaled to nothing drops its triangles: hits can't be followed, and reprojection gives way to casting."""
    from renderers.scene.model import Channel

    scene = room()
    node = next(i for i, n in enumerate(scene.nodes) if n.name == "cube")
    times = np.arange(5.0) / 24
    scales = np.array([[1.0] * 3, [1.0] * 3, [0.0] * 3, [0.0] * 3, [1.0] * 3])
    from dataclasses import replace

    animated = replace(scene, channels=(Channel("node", node, "scale", times, scales, "STEP"),))
    assert not motion_between(animated.world(1), animated.world(2)).same_topology
    frames = frames_of(animated, 5, prediction="reproject", delta_max=2)
    assert all(f.counters["pixels_missed"] == 0 for f in frames)
    assert all(np.isfinite(f.layers["beauty"]).all() for f in frames)


def test_a_range_begun_anew_gives_the_same_bytes() -> None:
    scene = room(cube=lambda t: np.stack([0.01 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1), frames=20)
    whole = frames_of(scene, 6, first=2)
    halted = METHOD.render_frames(scene, TrcSettings(**COARSE), size=SIZE, frames=(2, 7))  # type: ignore[arg-type]
    next(halted)
    again = frames_of(scene, 6, first=2)
    for one, other in zip(whole, again, strict=True):
        assert one.layers["beauty"].tobytes() == other.layers["beauty"].tobytes()
        assert one.counters == other.counters


@pytest.mark.slow
def test_a_thousand_frames_without_growth() -> None:
    """What is kept doesn't grow: as many records live, and as much memory is held, after 1,000 frames as after 250."""
    import tracemalloc

    turn = lambda t: np.stack([0.6 * np.cos(t / 40), 0.3 * np.sin(t / 40), 0.45 + 0 * t], 1)  # noqa: E731
    scene = room(cube=turn, frames=1100)
    chosen = TrcSettings(rays=16, a=0.8, delta_max=10)
    held, alive = [], []
    tracemalloc.start()
    for k, frame in enumerate(METHOD.render_frames(scene, chosen, size=(12, 9), frames=(0, 999))):
        if k in (249, 999):
            held.append(tracemalloc.get_traced_memory()[0])
            alive.append(frame.counters["records_alive"])
    tracemalloc.stop()
    assert held[1] < 1.3 * held[0]
    assert alive[1] < 1.5 * alive[0]
