"""What foresees the next frame, against the specification's checks: reprojection and recasting in lit rooms."""

from collections import Counter

import numpy as np
import pytest
from caching_rooms import ALBEDOS_2, EYE_2, FORWARD_2, FOV_2, INTENSITY_2, shell
from numpy.typing import NDArray
from temporal_rooms import FPS, room, toy_box

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.shapes import sphere
from renderers.transport.caching.hemisphere import grid_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Records, Sites
from renderers.transport.temporal.motion import Motion, motion_between
from renderers.transport.temporal.prediction import RayCast, Reprojection
from renderers.transport.temporal.records import Timed
from renderers.transport.temporal.sampling import Ahead, TemporalSampler
from renderers.transport.temporal.trends import Trends

F64 = NDArray[np.float64]
GRID = grid_of(4096)


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
    places = np.array([(0.02, 0.01, 0), (0.2, -0.1, 0), (-0.3, 0.2, 0)])
    up = np.broadcast_to([0.0, 0, 1], places.shape)
    sites = Sites((places - motion.before.centre) * motion.before.scale, up, up)
    now, exact = (sampled(world_sampler(w), sites).irradiance[:, 0] for w in (motion.before, motion.after))
    seen = {}
    for name, ahead in predictors(motion).items():
        seen[name] = (sampled(world_sampler(motion.before), sites, ahead).irradiance[:, 0] - now) / (exact - now)
    for name in ("points 1", "points 4"):
        assert ((seen[name] >= 0.3) & (seen[name] <= 1.3)).all(), seen
    assert np.abs(seen["points 4"] - 1).mean() < np.abs(seen["points 1"] - 1).mean(), seen


class Estimates:
    """Irradiance at random places of the box: now, one frame later, and foreseen; of one frame after another."""

    def __init__(self, scene: Scene, frames: tuple[int, ...] = (5, 24, 40, 58, 77, 101), count: int = 16) -> None:
        rng, found = np.random.default_rng(1), []
        for frame in frames:
            xy, wall = rng.uniform(-0.95, 0.95, (count, 2)), rng.random(count)[:, None] < 0.5
            on_wall = np.stack([-np.ones(count), xy[:, 0], xy[:, 1] + 1], 1)
            position = np.where(wall, on_wall, np.stack([*xy.T, np.zeros(count)], 1))
            normal = np.where(wall, [[1.0, 0, 0]], [[0, 0, 1.0]])
            found.append(self._errors(scene, frame, position, normal))
        self.errors = {name: np.concatenate([part[name] for part in found]) for name in found[0]}

    def _errors(self, scene: Scene, frame: int, position: F64, normal: F64) -> dict[str, F64]:
        motion = motion_between(scene.world(frame), scene.world(frame + 1))
        sites = Sites((position - motion.before.centre) * motion.before.scale, normal, normal)
        now, later = (sampled(world_sampler(w), sites).irradiance[:, 0] for w in (motion.before, motion.after))
        errors = {"none": now / later - 1}
        for name, ahead in predictors(motion).items():
            errors[name] = sampled(world_sampler(motion.before), sites, ahead).irradiance[:, 0] / later - 1
        return errors

    def mean(self, name: str) -> float:
        return float(np.abs(self.errors[name]).mean())


def world_sampler(world: object) -> TemporalSampler:
    return TemporalSampler(world, GRID, ReflectedDirectLight(world), 0, Counter())  # type: ignore[arg-type]


def sampled(sampler: TemporalSampler, sites: Sites, ahead: Ahead | None = None) -> Records:
    """What will be, or is where nothing foresees."""
    return sampler.sample(sites, np.arange(len(sites.position)), ahead)[1]


def predictors(motion: Motion) -> dict[str, Ahead]:
    sampler, later = world_sampler(motion.before), ReflectedDirectLight(motion.after)
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


def test_a12_nothing_that_rests_is_touched() -> None:
    world = room().world()
    motion = motion_between(world, room().world())
    assert motion.still
    sites = Sites(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.array([[0.0, 0, 1]]))
    now = sampled(world_sampler(world), sites)
    for ahead in predictors(motion).values():
        np.testing.assert_array_equal(sampled(world_sampler(world), sites, ahead).irradiance, now.irradiance)


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
