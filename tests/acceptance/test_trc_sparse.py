"""Foresight by a part of the rays: how far it is from that by all of them."""

import numpy as np
import pytest
from numpy.typing import NDArray
from temporal_frames import polar, sampled
from temporal_rooms import floor, line, room, yard

from renderers import load_scene
from renderers.transport.caching.hemisphere import grid_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal import sampling
from renderers.transport.temporal.lifespan import darkness, irradiance_rate, lifespan
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.prediction import RayCast
from renderers.transport.temporal.trends import Trends

F64 = NDArray[np.float64]


def foresights(name: str, frame: int, count: int = 96, rays: int = 1024) -> tuple[F64, F64, F64]:
    """Irradiance (K, 3) at pixels of a built-in scene, and its change to the next frame by all rays and by one in four, where
    hemispheres change as a whole."""
    scene = load_scene(name)
    motion = motion_between(scene.world(frame), scene.world(frame + 1))
    gbuffer = cast_gbuffer(motion.before, (64, 48))
    rows = np.random.default_rng(frame).choice(np.flatnonzero(gbuffer.covered.ravel()), count, replace=False)
    sites = Sites(*receivers_of(motion.before, gbuffer, rows))
    changes = []
    for sparse in (1, 4):
        sampler = polar(motion.before, rays, sparse)
        ahead = RayCast(motion, sampler, ReflectedDirectLight(motion.after))
        assert ahead.changes(sites).all()
        now, later = sampled(sampler, sites, ahead)
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


@pytest.mark.parametrize("lamp", [False, True])
def test_what_counts_as_noise_of_a_part_of_the_rays(monkeypatch: pytest.MonkeyPatch, lamp: bool) -> None:
    """Many cubes move: the variance of a mean over C of N cells, 1/C - 1/N of that of a cell; none where a lamp moves."""
    scene = room(lamp=line((-0.4, 0, 2.5), (0.1, 0, 0))) if lamp else yard("point", 24)
    motion, shares = motion_between(scene.world(0), scene.world(1)), list[float]()
    certain = sampling._certain
    monkeypatch.setattr(
        sampling, "_certain", lambda change, differences, share: shares.append(share) or certain(change, differences, share)
    )
    sampler = polar(motion.before, 1024, sparse=4)
    sampled(sampler, floor(motion.before, [(0.1, 0.2), (-0.5, 1.0)]), RayCast(motion, sampler, ReflectedDirectLight(motion.after)))
    assert shares == [0.0 if lamp else pytest.approx(1 / grid_of(256).cells - 1 / grid_of(1024).cells)]


@pytest.mark.parametrize("coefficients", [0, 9])
def test_changes_are_reduced_by_their_noise_unless_they_drown_in_it(coefficients: int) -> None:
    """Neighbouring cells differ by 2 in turn: variance 2 of a cell. Changes whose squares are 2, 20/19 and 1/10 of the noise are
    scaled to roots of 1/2, of (20/19 - 1) or a ninth, whichever is more, and not at all."""
    cells, share = np.where(np.arange(8) % 2, 1.0, -1.0)[None, None, :, None] * np.ones((3, 4, 1, 3)), 0.01
    part = np.array([0.5, 0.95, 10.0])
    expected = np.sqrt([0.5, 0.95 / 9, 1.0])
    light, gradients = np.ones((3, 3)), np.ones((3, 3, 3))
    if coefficients:
        noise = 2 * np.pi * coefficients * 2 * share
        values = np.sqrt(noise / part / coefficients)[:, None, None] * np.ones((1, coefficients, 3))
        change = Trends(light, gradients, gradients, values, np.ones((3, 2, coefficients, 3)))
        found = sampling._certain(change, cells.astype(np.float32), share)
        assert found.coefficients is not None
        np.testing.assert_allclose(found.coefficients, values * expected[:, None, None], rtol=1e-6)
        return
    change = Trends(np.sqrt(np.pi**2 * 2 * share / part)[:, None] * light, gradients, gradients)
    found = sampling._certain(change, cells.astype(np.float32), share)
    np.testing.assert_allclose(found.irradiance, change.irradiance * expected[:, None], rtol=1e-6)
    np.testing.assert_allclose(found.rotation, np.ones((3, 3, 3)) * expected[:, None, None], rtol=1e-6)


def test_coarse_cells_lie_evenly_within_theirs() -> None:
    """One in each; along a ring half of them in its upper half, along a column half of them in its later half."""
    fine, few = grid_of(4096), grid_of(1024)
    grid, cells = sampling.coarse(fine, few)
    assert grid == few
    row, column = np.divmod(cells, fine.sectors)
    ring, sector = row * few.rings / fine.rings, column * few.sectors / fine.sectors
    numbers = np.divmod(np.arange(few.cells), few.sectors)
    for place, number, axis in ((ring, numbers[0], 1), (sector, numbers[1], 0)):
        # cells of the fine grid needn't divide those of the coarse one
        assert (np.abs(place - number - 0.5) <= 0.5 + few.rings / fine.rings).all()
        late = (place - number >= 0.5).reshape(few)
        assert (np.abs(late.mean(axis=axis) - 0.5) < 0.2).all()


def test_lights_of_a_part_are_sampled_as_those_of_the_whole() -> None:
    """Below an area light, cell by cell: what a part foresees is what the next frame's whole hemispheres see."""
    scene = yard("area", 24)
    motion, places, number = motion_between(scene.world(0), scene.world(1)), np.array([(0.1, 0.2), (-0.5, 1.0)]), np.array([6, 2])
    here, cells = floor(motion.before, places), sampling.coarse(grid_of(1024), grid_of(256)).cells
    sampler = polar(motion.before, 1024)
    cast, _ = sampler.cast(here, number)
    found, _ = RayCast(motion, sampler, ReflectedDirectLight(motion.after))(cast.part(np.arange(2), cells))
    whole, _ = polar(motion.after, 1024).cast(here, number)
    np.testing.assert_allclose(found.radiance.reshape(2, -1, 3), whole.found.radiance.reshape(2, -1, 3)[:, cells], atol=1e-5)
