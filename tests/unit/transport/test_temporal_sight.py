"""Records that outlive their frame see their zones anew when they are computed anew."""

from collections import Counter

import numpy as np
import pytest
from caching_rooms import room_2, sites

from renderers.methods.ray_records import glossy_placement_of, placement_of
from renderers.methods.trc import TrcSettings
from renderers.transport.caching.hemisphere import Grid
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.limits import Limits
from renderers.transport.caching.placement import Placement
from renderers.transport.caching.splat import Canvas
from renderers.transport.temporal.cache import Policy, Stage, TemporalCache, View
from renderers.transport.temporal.sampling import TemporalSampler

LAMP = (1.0, 0.0, 2.7)
WALL = (((-0.01, -2, 0), (0.01, 2, 2.999)),)
LINE = np.concatenate([-np.arange(0.025, 1.5001, 0.025)[::-1], np.arange(0.025, 1.5001, 0.025)])


@pytest.mark.parametrize("sees", [True, False])
def test_a_wall_that_comes_ends_the_zones_of_records_renewed_in_place(sees: bool) -> None:
    """A lit floor, then a thin wall across it: in its second frame the dark side is black, although records of the first have their
    places and reached across. Without sight the wall leaks."""
    worlds = room_2((), LAMP).world(), room_2(WALL, LAMP).world()
    points = np.stack([LINE, np.full_like(LINE, 0.3), np.zeros_like(LINE)], axis=1)
    cache = TemporalCache(Policy(longest=1, guard=False, stagger=False, follows=False))
    for frame, world in enumerate(worlds):
        here = sites(world, points, np.tile([0, 0, 1.0], (len(LINE), 1)))
        canvas = Canvas(np.arange(len(LINE)), len(LINE), here.position, here.normal, np.float64)
        sampler = TemporalSampler(world, Grid(36, 114), ReflectedDirectLight(world), 0, Counter())
        limits = Limits(0.02 * world.scale, 2.0, metric="hessian")
        stage = Stage(frame, sampler, sampler, None, Placement(0.5, limits=limits, sees=sees), False, frame)
        renewed = cache.step(stage, [View(canvas, here)], Counter())
    assert len(renewed)
    light = canvas.irradiance[:, 0]
    assert light[LINE < 0].any() != sees
    if sees:
        assert light[LINE > 0].min() > 0.2 * light.max()


@pytest.mark.parametrize(("placement", "metric", "gradient", "sees"), [
    ("auto", "hessian", True, True), ("hessian-bounded", "hessian", True, True), ("hessian", "hessian", False, True),
    ("bounded", "split-sphere", True, False), ("split-sphere", "split-sphere", False, False),
])  # fmt: skip
def test_what_a_placement_stands_for(placement: str, metric: str, gradient: bool, sees: bool) -> None:
    how = placement_of(room_2().world(), 48, TrcSettings(placement=placement), 0)  # type: ignore[arg-type]
    assert (how.limits.metric, how.limits.gradient, how.sees) == (metric, gradient, sees)


def test_smallest_reach_and_the_accuracy_of_each_cache() -> None:
    """A record's smallest reach a·R is `footprint` pixels at its distance; those of radiance go by `glossy_a`, not by curvature."""
    settings = TrcSettings(a=0.2, glossy_a=0.05, footprint=3.0)
    world = room_2().world()
    pixel = 2 * np.tan(world.camera.yfov / 2) / 48
    for placement, a in ((placement_of(world, 48, settings, 0), 0.2), (glossy_placement_of(world, 48, settings, 0), 0.05)):
        assert placement.a == a
        assert placement.limits.footprint is not None
        point = world.camera.pose[:3, 3] + np.array([[0.0, 0.3, 0.4]])
        assert a * placement.limits.footprint.radius(point)[0] == pytest.approx(3 * pixel * 0.5)
    assert (placement.limits.metric, placement.sees) == ("split-sphere", False)
