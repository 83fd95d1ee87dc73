"""Photon-mapped irradiance caching on curved and on glossy surfaces: area counted by points, radiance records, traced lobes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from photon_rooms import made, on_plane, photon_box

import renderers
from renderers.methods.pmic import PhotonMappedIrradianceCaching, PmicSettings
from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import lathe
from renderers.scene.model import Lambert, PointLight
from renderers.scene.world import World
from renderers.transport.hemispherical.projection import irradiance
from renderers.transport.photons.density import CURVED_SLAB, Points, lookup
from renderers.transport.photons.density import irradiance as looked_up
from renderers.transport.photons.glossy import radiance_of_zones
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.refine import refined
from renderers.transport.photons.surface import PER_PHOTON, UNMEASURED, spread, surface_of
from renderers.transport.photons.tracing import trace
from renderers.transport.photons.walk import walk
from renderers.transport.photons.zones import Recipe, Zones, zones_of
from renderers.transport.sampling import cosine_hemisphere

METHOD = PhotonMappedIrradianceCaching()
SIZE = (48, 36)
RNG = np.random.default_rng(606)


def recipe(n_min: int = 8, a: float = 0.3, smallest: float = 0.01) -> Recipe:
    return Recipe(a, smallest, 1.0, 50, n_min, 2, 0, 500, 8, 24)


# --- curved surfaces -----------------------------------------------------------------------------------------------------------


@cache
def ball() -> World:
    """A smooth hollow ball, as large as the World's box, with a lamp in its centre."""
    polar = np.linspace(np.pi - 0.01, 0.01, 129)
    b = SceneBuilder("ball")
    b.place(lathe(np.stack([np.sin(polar), np.cos(polar)], axis=1), 192), b.material(Lambert("grey", (0.5,) * 3)), "ball")
    b.light(PointLight("lamp"), (0.0, 0.0, 0.0))
    b.camera((0, 0, 0.5), (0, 0, 0), 1.0)
    return b.build().world()


def test_surface_points_are_spread_by_area() -> None:
    """On a ball equal heights have equal areas (Archimedes); points are stratified along the triangles, which go up in rings."""
    world, count = ball(), 20_000
    position, normal = spread(world, count)
    size = float(np.abs(world.positions).max())
    height = np.sort(position[:, 1]) / size
    assert np.abs(height - np.linspace(-1, 1, count)).max() < 0.02  # a ring of triangles is 0.025 high, and its points are random
    assert np.linalg.norm(normal, axis=1) == pytest.approx(np.ones(count), abs=1e-6)
    radial = position / np.linalg.norm(position, axis=1, keepdims=True)
    assert np.abs(np.einsum("nc,nc->n", radial, normal)).min() > 0.99


def test_flat_scenes_have_no_surface_points() -> None:
    assert surface_of(photon_box().world(), 1000) is UNMEASURED
    surface = surface_of(ball(), 1000)
    assert len(surface.tree.positions) == PER_PHOTON * 1000


def test_on_a_sphere_the_counted_area_is_right_where_the_hull_is_too_small() -> None:
    """Zones of a quarter of the radius R: the hull is 1/(1 - r²/4R²) = 1.016 too bright (H11), counted area is right."""
    world, count, share = ball(), 300_000, 0.25
    size = float(np.abs(world.positions).max())
    n = RNG.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    photons = made(size * n, -n, distance=share * size / 0.3)
    own, p = np.arange(0, count, 1000), photons.photons  # in tree order: all over the ball
    where = Points(p.position[own].astype(float), p.normal[own].astype(float), np.full(300, CURVED_SLAB))
    counted = zones_of(replace(photons, surface=surface_of(world, count)), where, own, recipe())
    hull = zones_of(photons, where, own, recipe())
    assert counted.reach == pytest.approx(np.full(300, share * size), rel=1e-5)
    sphere = 4 * np.pi * size**2
    # 300 zones of 4700 photons cover the sphere several times: the mean's noise is that of the photons, 0.2 %
    assert counted.irradiance[:, 0].mean() * sphere == pytest.approx(1.0, abs=0.006)
    assert hull.irradiance[:, 0].mean() * sphere == pytest.approx(1 / (1 - share**2 / 4), abs=0.006)
    assert (counted.vertices == 0).all()


def column() -> World:
    b = SceneBuilder("column")
    b.place(lathe([(0.02, 0.0), (0.02, 1.0)], 24), b.material(Lambert("grey", (0.5,) * 3)), "column")
    b.light(PointLight("lamp"), (1.0, 0.5, 0.0))
    b.camera((1, 0.5, 1), (0, 0.5, 0), 1.0)
    return b.build().world()


def test_few_photons_on_a_thin_column_make_no_bright_spots() -> None:
    """300 photons on a column 25 times as high as thick: zones take in more of its round, not slivers of three photons.

    Zones hold 20 photons, some at its ends 10: E spreads by 1/√n, 20 to 30 %, and the bounds are three to four times that off.
    """
    world, count = column(), 300
    phi, height = 2 * np.pi * RNG.random(count), RNG.random(count)
    n = np.stack([np.cos(phi), np.zeros(count), np.sin(phi)], axis=1)
    position = (0.02 * n + height[:, None] * np.array([0.0, 1.0, 0.0]) - world.centre) * world.scale
    photons = made(position, n, distance=0.05)
    photons = replace(photons, surface=surface_of(world, 20_000))
    p = photons.photons
    where = Points(p.position.astype(float), p.normal.astype(float), np.full(count, CURVED_SLAB))
    found = zones_of(photons, where, np.arange(count), recipe(n_min=20))
    ratio = found.irradiance[:, 0] * world.areas.sum()
    assert found.photons.min() >= 5
    assert np.median(ratio) == pytest.approx(1.0, abs=0.2)
    assert ratio.max() < 2.2
    assert ratio.min() > 0.1


def test_refinement_goes_on_with_counted_areas() -> None:
    """Eight rounds on the inner surface of a sphere: less than two thirds of one round's error, and no bias."""
    world = ball()

    def spread_of(rounds: int) -> tuple[float, float]:
        photons = photon_map(trace(world, 5_000, seed=2))
        photons = replace(photons, surface=surface_of(world, 50_000))
        kept = walk(world, photons, recipe(50, smallest=0.1))
        outer = np.linalg.norm(kept.records.position, axis=1) > 0.5
        found = refined(world, photons, kept, 2, 2, rounds).records.irradiance[outer, 0]
        return float(found.std() / found.mean()), float(found.mean())

    (noise, mean), (less, refined_mean) = spread_of(1), spread_of(8)
    assert less < noise * 2 / 3
    assert refined_mean == pytest.approx(mean, rel=0.05)


# --- glossy surfaces -----------------------------------------------------------------------------------------------------------


def glossy_plane() -> tuple[PhotonMap, Points, np.ndarray, Zones]:
    count = 40_000
    local = cosine_hemisphere(np.tile([0.0, 0.0, 1.0], (count, 1)), RNG.random((count, 2)))
    photons = on_plane(RNG.random((count, 2)), direction=local, distance=0.3)
    p = photons.photons
    inner = np.flatnonzero((np.abs(p.position[:, :2] - 0.5) < 0.3).all(axis=1))
    rows = inner[:: len(inner) // 40][:40]  # in tree order: all over the plane
    where = Points(p.position[rows].astype(float), p.normal[rows].astype(float), np.full(40, 0.02))
    return photons, where, rows, zones_of(photons, where, rows, recipe())


@pytest.mark.parametrize("order", [2, 6])
def test_coefficients_hold_the_irradiance_of_the_zone(order: int) -> None:
    """The cosine is two of the functions, so E follows from the coefficients: only photons under the clamp (0.0025) lose some."""
    photons, where, rows, zones = glossy_plane()
    light = radiance_of_zones(photons, where, rows, zones, order)
    assert light.shape == (40, order**2, 3)
    held = irradiance(np.moveaxis(light, 1, 0))
    assert held == pytest.approx(zones.irradiance, rel=0.01)
    assert held.mean() == pytest.approx(zones.irradiance.mean(), rel=0.002)


def test_uniform_light_has_one_coefficient() -> None:
    """L = E/π everywhere is √(2π) L H_00, less 2.5 % of its solid angle that the clamp takes; all others are noise."""
    photons, where, rows, zones = glossy_plane()
    mean = radiance_of_zones(photons, where, rows, zones, 4)[..., 0].mean(axis=0)
    level = np.sqrt(2 * np.pi) / np.pi
    assert mean[0] == pytest.approx(level, rel=0.05)
    assert np.abs(mean[1:]).max() < 0.1 * level


@cache
def indirect_truth(exponent: float, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Indirect radiance of the glossy Cornell box by path tracing."""
    pt, scene = renderers.get_method("pt"), renderers.load_scene("cornell-glossy", exponent=exponent)
    full = pt.render(scene, pt.Settings(spp=4096), size=size).layers["beauty"]
    return full.astype(np.float64) - pt.render(scene, pt.Settings(transport="direct", spp=64), size=size).layers["beauty"]


def error(kind: str, exponent: float = 20.0, **settings: object) -> float:
    method, scene = renderers.get_method(kind), renderers.load_scene("cornell-glossy", exponent=exponent)
    image = method.render(scene, method.Settings(**settings), size=SIZE, seed=1).layers["indirect"]
    truth = indirect_truth(exponent)
    return float(np.sqrt(np.mean((image - truth) ** 2)) / truth.mean())


@pytest.mark.mitsuba
def test_radiance_records_of_a_glossy_wall_beat_direct_visualisation() -> None:
    cached = error("pmic")
    assert cached <= error("photon-map", photons=400_000) / 2
    assert cached <= error("pmic", glossy="diffuse") / 2


@pytest.mark.mitsuba
def test_lobes_too_sharp_for_records_are_traced() -> None:
    scene, settings = renderers.load_scene("cornell-glossy", exponent=500.0), PmicSettings(photons=100_000)
    frame = METHOD.render(scene, settings, size=SIZE, seed=1)
    assert frame.counters["pixels_traced"] > 100
    assert "radiance_records" not in frame.counters
    assert frame.layers["indirect"].mean() == pytest.approx(indirect_truth(500.0).mean(), rel=0.05)


def test_glossy_views_of_one_cache() -> None:
    """A walkthrough's first frame is the single frame, and every glossy pixel may have a zone of its own."""
    scene, settings = renderers.load_scene("cornell-glossy"), PmicSettings(photons=20_000)
    single = METHOD.render(scene, settings, size=(16, 12))
    frames = METHOD.walkthrough(scene, settings, [scene.world().camera] * 2, size=(16, 12))
    assert single.counters["radiance_records"] > 0
    for frame in frames:
        assert frame.layers["beauty"].tobytes() == single.layers["beauty"].tobytes()
    each = METHOD.render(scene, PmicSettings(photons=20_000, records="pixels"), size=(16, 12))
    assert each.counters["pixels_missed"] == each.counters["pixels_covered"]
    assert each.layers["indirect"].mean() == pytest.approx(single.layers["indirect"].mean(), rel=0.1)


# --- what the specification says in passing ------------------------------------------------------------------------------------


def test_h2_density_of_fifty_photons_is_right_to_five_percent() -> None:
    photons = on_plane(RNG.random((100_000, 2)))
    xy = 0.2 + 0.6 * RNG.random((2000, 2))
    where = Points(np.column_stack([xy, np.zeros(2000)]), np.tile([0.0, 0.0, 1.0], (2000, 1)), np.full(2000, 0.02))
    assert looked_up(photons, where, lookup(51, 0.2, "corrected"))[:, 0].mean() == pytest.approx(1.0, abs=0.05)


@pytest.mark.mitsuba
def test_h14_larger_zones_blur_more_than_they_save_at_many_photons() -> None:
    pt, scene, size = renderers.get_method("pt"), photon_box(), (32, 24)
    direct = pt.render(scene, pt.Settings(transport="direct", spp=16), size=size).layers["beauty"]
    truth = pt.render(scene, pt.Settings(spp=4096), size=size).layers["beauty"].astype(np.float64) - direct
    errors = []
    for a in (0.3, 0.5):
        found = METHOD.render(scene, PmicSettings(photons=1_000_000, a=a), size=size, seed=1).layers["indirect"]
        errors.append(np.sqrt(np.mean((found - truth) ** 2)))
    assert errors[1] > 1.2 * errors[0]


def test_c3_work_does_not_grow_with_triangles() -> None:
    """Every triangle in 64: the same photons but for rounding, so as many records and zones within 3 %."""
    from benchmarks.pmic import split

    world = photon_box().world()
    finer = world
    for _ in range(3):
        finer = split(finer)
    counts = []
    for each in (world, finer):
        counters = Counter[str]()
        walk(each, photon_map(trace(each, 50_000, seed=1)), recipe(smallest=0.05), counters=counters)
        counts.append((counters["records"], counters["zones"]))
    assert counts[1] == pytest.approx(counts[0], rel=0.03)
