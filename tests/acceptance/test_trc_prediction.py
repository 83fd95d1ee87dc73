"""What foresees the next frame, against the specification's checks: reprojection and recasting in lit rooms."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
from caching_rooms import ALBEDOS_2, EYE_2, FORWARD_2, FOV_2, INTENSITY_2, shell, sites
from numpy.typing import NDArray
from temporal_frames import polar, sampled
from temporal_rooms import FPS, floor, floor_and_wall, line, room, toy_box, yard

from renderers.methods.foresight import ahead_of, samplers_of
from renderers.methods.trc import TrcSettings
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.shapes import sphere
from renderers.scene.world import World
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Records, Sites
from renderers.transport.temporal.motion import Motion, motion_between
from renderers.transport.temporal.prediction import RayCast, Reprojection
from renderers.transport.temporal.records import Timed
from renderers.transport.temporal.sampling import Ahead
from renderers.transport.temporal.trends import Trends

F64 = NDArray[np.float64]


def approaching(magnification: float) -> Scene:
    """A ball of radius 0.3 over the floor's middle, whose centre comes nearer from 0.65 in one frame; a lamp at the side."""
    b = SceneBuilder("approaching-ball")
    shell(b, ALBEDOS_2)
    node = b.place(sphere(0.3, 96, 48), b.material(Lambert("ball", (0.75,) * 3)), "ball")
    b.light(PointLight("lamp", (1.0, 1.0, 1.0), INTENSITY_2), (1.2, -0.8, 1.6))
    b.camera(EYE_2, EYE_2 + FORWARD_2, FOV_2, (0, 0, 1))
    heights = np.array([0.65, 0.65 / magnification])
    b.animate(node, "translation", np.arange(2) / FPS, np.stack([0 * heights, 0 * heights, heights], 1))
    return b.build(fps=FPS, frames=2)


@pytest.mark.parametrize("magnification", [1.18, 1.44])
def test_h7_an_approaching_ball_in_a_lit_room(magnification: float) -> None:
    """Places under it see between 0.3 and 1.3 of the change, by single points too; footprints come nearer to it."""
    scene = approaching(magnification)
    motion = motion_between(scene.world(0), scene.world(1))
    places = floor(motion.before, [(0.02, 0.01), (0.2, -0.1), (-0.3, 0.2)])
    now, exact = (irradiance(w, places) for w in (motion.before, motion.after))
    seen = {}
    for name, ahead in predictors(motion).items():
        seen[name] = (irradiance(motion.before, places, ahead) - now) / (exact - now)
    for name in ("points 1", "points 4"):
        assert ((seen[name] >= 0.3) & (seen[name] <= 1.3)).all(), seen
    assert np.abs(seen["points 4"] - 1).mean() < np.abs(seen["points 1"] - 1).mean(), seen


class Estimates:
    """Irradiance at random places of the box: now, one frame later, and foreseen; of one frame after another."""

    def __init__(self, scene: Scene, frames: tuple[int, ...] = (5, 24, 40, 58, 77, 101), count: int = 16) -> None:
        rng, found = np.random.default_rng(1), []
        for frame in frames:
            motion = motion_between(scene.world(frame), scene.world(frame + 1))
            places = floor_and_wall(motion.before, rng, count)
            later = irradiance(motion.after, places)
            ways = {"none": None, **predictors(motion)}
            found.append({name: irradiance(motion.before, places, ahead) / later - 1 for name, ahead in ways.items()})
        self.errors = {name: np.concatenate([part[name] for part in found]) for name in found[0]}

    def mean(self, name: str) -> float:
        return float(np.abs(self.errors[name]).mean())


def irradiance(world: World, places: Sites, ahead: Ahead | None = None) -> F64:
    """What will be, or is where nothing foresees, of one channel."""
    return np.asarray(sampled(polar(world), places, ahead)[1].irradiance[:, 0])


def predictors(motion: Motion) -> dict[str, Ahead]:
    sampler, later = polar(motion.before), ReflectedDirectLight(motion.after)
    points = {f"points {f}": Reprojection(motion, sampler, later, f) for f in (1, 4)}
    return {"raycast": RayCast(motion, sampler, later), **points}


@pytest.fixture(scope="module")
def full_speed() -> Estimates:
    return Estimates(toy_box())


def test_a13_reprojection_beats_no_foresight(full_speed: Estimates) -> None:
    assert full_speed.mean("points 4") < 0.6 * full_speed.mean("none")
    slow = Estimates(toy_box(0.3, 0.3))
    assert slow.mean("points 4") < 1.0 * slow.mean("none")
    # single points can't follow what moves by less than a cell
    assert slow.mean("points 1") > slow.mean("points 4")


def test_recasting_only_what_may_have_changed_is_exact(full_speed: Estimates) -> None:
    """The same hemispheres, cast whole: what isn't cast or shaded anew has the same bits, the rest differs by Embree's rounding."""
    np.testing.assert_allclose(full_speed.errors["raycast"], 0, atol=1e-5)


@pytest.mark.parametrize("light", ["point", "spot", "directional", "area", "sky"])
@pytest.mark.parametrize("cubes", [1, 24])
def test_recasting_is_exact_under_any_light(light: str, cubes: int) -> None:
    """Few things that move are told by their boxes, many by rays cast at them alone; what shades the floor is the cubes."""
    scene = yard(light, cubes)
    assert exactly_foreseen(motion_between(scene.world(0), scene.world(1)))


def test_recasting_is_exact_where_a_surface_is_painted_anew() -> None:
    before, after = yard("point", 1), yard("point", 1, wall=0.2)
    motion = motion_between(before.world(0), after.world(0))
    assert motion.materials
    assert not motion.still
    assert not motion.moved.any()
    assert exactly_foreseen(motion)


def some_floor(motion: Motion, count: int = 16) -> Sites:
    """Places under the cubes of the yard."""
    return floor(motion.before, np.random.default_rng(2).uniform((-1.6, -0.4), (1.6, 1.4), (count, 2)))


def exactly_foreseen(motion: Motion) -> bool:
    """Whether records under the cubes change, and to what the next frame's hemispheres say, to Embree's rounding."""
    places, sampler = some_floor(motion), polar(motion.before, 256)
    now, later = sampled(sampler, places, RayCast(motion, sampler, ReflectedDirectLight(motion.after)))
    exact, _ = sampled(polar(motion.after, 256), places)
    changed = np.abs(exact.irradiance - now.irradiance).max(axis=1) > 1e-3 * now.irradiance.max()
    for name in ("irradiance", "translation", "rotation"):
        expected = getattr(exact, name)
        np.testing.assert_allclose(getattr(later, name), expected, atol=1e-4 * np.abs(expected).max())
    return bool(changed.sum() >= 4)


@pytest.mark.parametrize("chosen", [{}, {"prediction": "reproject"}, {"prediction": "reproject", "sampler": "plane"}])
def test_where_a_lamp_alone_moves_every_way_of_foresight_is_exact(chosen: dict[str, Any]) -> None:
    """As `trc` sets them up: what is seen stays where it is, in the light of the next frame."""
    scene, settings = room(lamp=line((-0.4, 0, 2.5), (0.3, 0, 0))), TrcSettings(rays=256, sparse=1, backend="cpu", **chosen)
    motion = motion_between(scene.world(0), scene.world(1))
    assert motion.lights
    here, there = (samplers_of(world, settings, 0, Counter(), None)[0] for world in (motion.before, motion.after))
    now, later = sampled(here, some_floor(motion), ahead_of(motion, here, settings))
    exact, _ = sampled(there, some_floor(motion))
    assert np.abs(now.irradiance / exact.irradiance - 1).max() > 0.02
    np.testing.assert_allclose(later.irradiance, exact.irradiance, rtol=1e-5)


def test_a_record_is_the_same_whatever_is_computed_with_it() -> None:
    """Places on a cube that moves and on the floor, in turn: those that go are foreseen apart from the others."""
    scene = room(cube=line((0.3, 0.4, 0.45), (0.1, 0, 0)))
    motion = motion_between(scene.world(0), scene.world(1))
    xyz = [(0.2, 0.3, 0.85), (-0.6, 0.4, 0), (0.5, 0.5, 0.85), (0.4, -0.5, 0), (0.1, 0.6, 0.85), (0.3, -0.2, 0)]
    places, number = sites(motion.before, xyz, np.tile([0.0, 0, 1], (6, 1))), np.array([4, 9, 2, 7, 1, 3])
    sampler = polar(motion.before, 1024, sparse=4)
    ahead = RayCast(motion, sampler, ReflectedDirectLight(motion.after))
    assert ahead.changes(places).tolist() == [True, False] * 3
    together = sampler.sample(places, number, ahead)
    for k in range(6):
        for one, all_ in zip(sampler.sample(places.rows([k]), number[k : k + 1], ahead), together, strict=True):
            np.testing.assert_allclose(one.irradiance[0], all_.irradiance[k], rtol=1e-12)
    assert (together[0].irradiance != sampler.sample(places, number + 1, ahead)[0].irradiance).any(axis=1).all()


def test_a12_nothing_that_rests_is_touched() -> None:
    world = room().world()
    motion = motion_between(world, room().world())
    assert motion.still
    sites = Sites(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.array([[0.0, 0, 1]]))
    for ahead in predictors(motion).values():
        now, later = sampled(polar(world), sites, ahead)
        np.testing.assert_array_equal(later.irradiance, now.irradiance)


def test_a19_an_interpolated_record_hands_over_its_successor_s_value() -> None:
    rng = np.random.default_rng(3)

    def some() -> Records:
        return Records(*(rng.random(shape) for shape in ((5, 3), (5, 3), (5,), (5, 3), (5, 3, 3), (5, 3, 3))))

    first, last, life = some(), some(), np.arange(2, 7)
    none = np.zeros(5, np.int64)
    sites = Sites(first.position, first.normal, first.normal)
    for k in range(5):
        timed = Timed.of(first, Trends.between(first, last, life.astype(float)), sites, none, 10, life, none, none)
        value = timed.at(10 + int(life[k]))
        for name in ("irradiance", "translation", "rotation"):
            np.testing.assert_allclose(getattr(value, name)[k], getattr(last, name)[k], rtol=1e-12)
