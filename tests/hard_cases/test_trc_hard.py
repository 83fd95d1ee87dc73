"""Temporal caching where it is hard: sudden changes, things that come and go, ends of ranges, long runs, cuts."""

from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import EYE_2, FORWARD_2, metres
from numpy.typing import NDArray
from temporal_frames import COARSE, METHOD, MODES, SIZE, assert_beginnings_agree, bytes_of, caches_of, frames_of, total
from temporal_rooms import line, room
from temporal_toy import hold_places

from renderers import Frame, get_method, load_scene
from renderers.methods.trc import TrcSettings
from renderers.scene.model import Channel, Scene
from renderers.transport.caching.splat import Canvas
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal.anchors import anchors
from renderers.transport.temporal.cache import Stage, View
from renderers.transport.temporal.coverage import coverage
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.records import Timed

F64 = NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("software_device")


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
    # a chord across the step rises before it; nothing else can know
    early = np.abs(frames[at - 1] - frames[0]) / abs(level[after] - level[before])
    assert early > 0.05 if mode == "interpolated" else early < 1e-6
    # the pair of frames that straddles the step extrapolates it; its records live for one frame, so nothing overshoots
    assert frames.max() <= max(level.values()) + tolerance


def test_a_strobe_falls_back_to_the_cost_of_per_frame_caching() -> None:
    """Light on and off in turn: nothing can be kept, and soon nothing is foreseen."""
    scene = room(intensity=lambda t: np.where(t % 2 == 0, 8.0, 2.0), frames=40)
    frames = frames_of(scene, 16)
    truth = indirect(exact(scene, 16))
    assert np.abs(indirect(frames) - truth).max() <= 0.05 * truth.max()
    late = frames[8:]
    predicted = total(late, "predictions")
    assert predicted <= 0.25 * total(late, "records")
    assert predicted < 0.3 * total(frames_of(scene, 16, guard=False)[8:], "predictions")


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
    enters = room(cube=line((-9, 0.4, 0.45), (0.8, 0, 0)), frames=20)
    cut = room(camera=lambda t: np.where((t < 3)[:, None], [[-0.2, -1.95, 1.5]], [[1.2, 0.2, 2.2]]), frames=20)
    for scene in (enters, cut):
        frames = frames_of(scene, 14 if scene is enters else 5, delta_max=3)
        assert all(f.counters["pixels_missed"] == 0 for f in frames)
    assert [f.counters["records_new"] > 0 for f in frames] == [True, False, False, True, False]
    # what the camera no longer sees is gone a life later
    assert frames_of(cut, 8, delta_max=3)[-1].counters["records_alive"] < frames[3].counters["records_alive"]


@MODES
def test_h20_one_frame_and_the_last_frames_of_an_animation(mode: str) -> None:
    scene = room(cube=line((0, 0.4, 0.45), (0.02, 0, 0)), frames=5)
    single = METHOD.render(scene, TrcSettings(**COARSE, gradients_in_time=mode), size=SIZE, frame=5)  # type: ignore[arg-type]
    assert np.isfinite(single.layers["beauty"]).all()
    assert all(np.isfinite(f.layers["beauty"]).all() for f in frames_of(scene, 3, first=3, gradients_in_time=mode))
    # the animation holds still after its last key
    beyond = frames_of(scene, 3, first=5, gradients_in_time=mode)
    assert beyond[-1].counters["records"] == 0
    assert beyond[1].layers["beauty"].tobytes() == beyond[2].layers["beauty"].tobytes()


def never_deleted(monkeypatch: pytest.MonkeyPatch, without_surface: bool) -> None:
    """Every place counts as one that reaches pixels; and, if so, as one with a surface."""

    def covered(live: Timed, stage: Stage, views: list[View]) -> Timed:
        return replace(live, covered=np.where(live.last == stage.frame, 1, live.covered))

    monkeypatch.setattr("renderers.transport.temporal.cache.cover", covered)
    if without_surface:
        hold_places(monkeypatch)


def test_h11_a26_c7_little_that_no_pixel_needs_stays_behind_a_moving_object(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cube that hides a part of the view as it slides by. As published, deletion by coverage leaves at most 5 % of the records
    without a pixel, and a tenth fewer alive than without, at least. It does so beyond the deletion of places without a surface."""
    scene, found = room(cube=line((-1.3, -0.9, 1.2), (0.03, 0, 0)), frames=40), {}
    for name in ("default", "published", "by surface", "none"):
        with monkeypatch.context() as patch:
            if name == "published":
                hold_places(patch)
            elif name != "default":
                never_deleted(patch, without_surface=name == "none")
            chosen = {} if name == "default" else {"follow": False, "guard": False}
            late = caches_of(patch, scene, 32, delta_max=2, a=0.3, **chosen)[-12:]
        useless = sum(int((reached(*frame) == 0).sum()) for frame in late)
        alive = sum(len(live) for live, *_ in late)
        found[name] = useless / alive, alive
    print(found)
    assert found["default"][0] <= 0.05
    assert found["published"][0] <= 0.05
    assert found["by surface"][0] > 0.1
    assert found["none"][0] > 0.2
    assert found["published"][1] < 0.9 * found["none"][1], found


def reached(live: Timed, stage: Stage, views: list[View]) -> NDArray[np.int64]:
    """Pixels of each record's zone, (K,)."""
    counts = [coverage(view.canvas, live.records, stage.placement.a, stage.placement.weight) for view in views]
    return np.sum(counts, axis=0)


def test_h10_records_that_an_object_moves_over_are_gone_a_life_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cube stands in the floor; places inside it that reach no pixel for a whole life aren't alive after it."""
    longest = 4
    path = line((-0.9, 0.4, 0.35), (0.08, 0, 0))
    frames = caches_of(monkeypatch, room(cube=path, frames=40), 20, delta_max=longest)
    useless = [set(live.place[reached(live, stage, views) == 0].tolist()) for live, stage, views in frames]
    inside = 0
    for t in range(len(frames) - longest):
        gone = set.intersection(*useless[t : t + longest])
        assert not gone & set(frames[t + longest][0].place.tolist())
        live, stage, _ = frames[t]
        away = np.abs(metres(stage.sampler.world, live.sites.position) - path(np.array([float(t)]))).max(axis=1)
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


@pytest.mark.parametrize("follow", [False, True])
def test_h19_what_turns_away_from_a_record_takes_nothing_of_it(monkeypatch: pytest.MonkeyPatch, follow: bool) -> None:
    """A cube tilts by 3° a frame. As published its records stay where they were made, with the normals that they had, to the bit;
    after 15° no pixel of the cube is in the zone of any, as √(1 - cos 15°) = 0.18 > a. Those that follow still serve it."""
    scene, a = room(cube=line((0.3, 0.4, 0.9), (0, 0, 0)), frames=8), 0.1
    node = next(i for i, n in enumerate(scene.nodes) if n.name == "cube")
    half = np.radians(3) / 2 * np.arange(9)
    tilt = Channel("node", node, "rotation", np.arange(9) / 24, np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], 1))
    chosen = {"delta_max": 20, "a_t": 10.0, "stagger": False, "lifespan": "rate", "a": a, "follow": follow}
    found = caches_of(monkeypatch, replace(scene, channels=(*scene.channels, tilt)), 6, **chosen)
    (first, stage, _), (last, later, _) = found[0], found[-1]
    here, there = stage.sampler.world, later.sampler.world
    on_cube = here.instance[anchors(here, first.sites).triangle] == here.instance.max()
    # its sides turn within their planes
    old = first.rows(on_cube & (np.abs(first.sites.normal[:, 0]) < 0.5) & np.isin(first.place, last.place))
    new = last.rows(np.isin(last.place, old.place))
    assert len(new) > 10
    gbuffer = cast_gbuffer(there, SIZE)
    cube = Canvas.of(gbuffer, gbuffer.covered & (there.instance[gbuffer.triangle] == there.instance.max()))
    served = coverage(cube, new.at(5), a) > 0
    if follow:
        assert served.mean() > 0.8
        return
    assert not served.any()
    np.testing.assert_array_equal(new.records.position, old.records.position)
    np.testing.assert_array_equal(new.records.normal, old.records.normal)


def test_c8_lives_are_short_where_light_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Near a cube that passes by they are at most 0.7 times as long as far from it, where they are nearly as long as may be."""
    path = line((-1.2, 0.9, 0.45), (0.06, 0, 0))
    live, stage, _ = caches_of(monkeypatch, room(cube=path, frames=20), 8, stagger=False, lifespan="rate", a=0.2)[-1]
    away = np.linalg.norm(metres(stage.sampler.world, live.sites.position) - path(np.array([7.0])), axis=1)
    near, far = live.life[away < 1.2], live.life[away > 2.5]
    assert min(len(near), len(far)) > 10
    assert near.mean() < 0.7 * far.mean()


def test_places_that_add_up_end_where_others_stand_in_for_them() -> None:
    """A camera comes near and goes back, a cube creeps. No pixel goes without a record, and beginnings stay what they are."""
    scene = room(
        cube=line((0.3, 0.4, 0.45), (0.002, 0, 0)),
        camera=lambda t: EYE_2 + np.outer(1.2 * np.sin(np.pi * np.minimum(t / 24, 1)), FORWARD_2),
        frames=30,
    )
    few = {"delta_max": 4, "a": 0.1, "rays": 64}
    ended, kept = assert_beginnings_agree(scene, 30, 0, (20,), **few), frames_of(scene, 30, guard=False, **few)
    assert total(ended, "pixels_missed") == 0
    assert ended[-1].counters["records_alive"] < 0.9 * kept[-1].counters["records_alive"]


def test_h16_lives_that_no_rate_can_tell_are_noted() -> None:
    for settings, said in (({"delta_max": 25}, 0), ({"delta_max": 26}, 1), ({"delta_max": 26, "cache": "static"}, 0)):
        assert len(frames_of(room(), 1, **settings)[0].notes) == said


def test_h12_staggered_expiry_has_no_pulses() -> None:
    scene = room(cube=line((0, 0.4, 0.45), (0.0005, 0, 0)), frames=40)
    peaks = {}
    for stagger in (True, False):
        renewed = np.array([f.counters["records_renewed"] for f in frames_of(scene, 22, delta_max=8, stagger=stagger)][1:])
        peaks[stagger] = renewed.max() / renewed.mean()
    assert peaks[False] > 3
    assert peaks[True] < 2.5


def test_a_scaled_away_object_changes_the_topology_and_is_survived() -> None:
    """An instance scaled to nothing drops its triangles: hits can't be followed, and reprojection gives way to casting."""
    scene = room()
    node = next(i for i, n in enumerate(scene.nodes) if n.name == "cube")
    times = np.arange(5.0) / 24
    scales = np.array([[1.0] * 3, [1.0] * 3, [0.0] * 3, [0.0] * 3, [1.0] * 3])
    animated = replace(scene, channels=(Channel("node", node, "scale", times, scales, "STEP"),))
    assert not motion_between(animated.world(1), animated.world(2)).same_topology
    frames = frames_of(animated, 5, prediction="reproject", delta_max=2)
    assert all(f.counters["pixels_missed"] == 0 for f in frames)
    assert all(np.isfinite(f.layers["beauty"]).all() for f in frames)


def test_a_range_begun_anew_gives_the_same_bytes() -> None:
    scene = room(cube=line((0, 0.4, 0.45), (0.01, 0, 0)), frames=20)
    whole = frames_of(scene, 6, first=2)
    halted = METHOD.render_frames(scene, TrcSettings(**COARSE), size=SIZE, frames=(2, 7))  # type: ignore[arg-type]
    next(halted)
    again = frames_of(scene, 6, first=2)
    for one, other in zip(whole, again, strict=True):
        assert bytes_of(one) == bytes_of(other)
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
