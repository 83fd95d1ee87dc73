"""Foresight by a part of the rays: how far it is from that by all of them."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from renderers import load_scene
from renderers.transport.caching.hemisphere import grid_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal.lifespan import darkness, irradiance_rate, lifespan
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.prediction import RayCast
from renderers.transport.temporal.sampling import TemporalSampler

F64 = NDArray[np.float64]


def foresights(name: str, frame: int, count: int = 96, rays: int = 1024) -> tuple[F64, F64, F64]:
    """Irradiance (K, 3) at pixels of a built-in scene, and its change to the next frame by all rays and by one in four, where
    hemispheres change as a whole."""
    scene = load_scene(name)
    motion, grid = motion_between(scene.world(frame), scene.world(frame + 1)), grid_of(rays)
    gbuffer = cast_gbuffer(motion.before, (64, 48))
    rows = np.random.default_rng(frame).choice(np.flatnonzero(gbuffer.covered.ravel()), count, replace=False)
    sites = Sites(*receivers_of(motion.before, gbuffer, rows))
    changes = []
    for sparse in (1, 4):
        sampler = TemporalSampler(motion.before, grid, ReflectedDirectLight(motion.before), 0, Counter(), sparse)
        ahead = RayCast(motion, sampler, ReflectedDirectLight(motion.after))
        assert ahead.changes(sites).all()
        now, later = sampler.sample(sites, np.arange(count), ahead)
        changes.append(later.irradiance - now.irradiance)
    return now.irradiance, changes[0], changes[1]


def test_a_quarter_of_the_rays_foresees_a_moving_light() -> None:
    """Off by less than 0.3 of the change, in the root of the mean square."""
    _, whole, part = foresights("moving-light", 40)
    assert np.sqrt(np.mean((part - whole) ** 2) / np.mean(whole**2)) < 0.3


def test_a_quarter_of_the_rays_gives_the_lives_of_all_in_the_mean() -> None:
    """66 balls move; of 1024 rays a quarter finds the change only to its own size, but lives neither shrink nor grow by half."""
    now, whole, part = foresights("bouncing-spheres", 50)
    least = darkness(now)
    lives = [lifespan(irradiance_rate(now, now + change, least), 0.05, 20).mean() for change in (whole, part)]
    assert 1 / 1.5 < lives[1] / lives[0] < 1.5, lives
