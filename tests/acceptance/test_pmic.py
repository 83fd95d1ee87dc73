"""Photon-mapped irradiance caching against closed forms, finite differences and path tracing (checks by number)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numba
import numpy as np
import pytest
from caching_rooms import POINTS_1, metres, radiance_1, room_1
from photon_rooms import on_plane, photon_box

import renderers
from renderers.methods.pmic import PhotonMappedIrradianceCaching, PmicSettings
from renderers.scene.world import World, WorldCamera
from renderers.transport.photons.cells import cell_sums, gradients_of
from renderers.transport.photons.density import Points, points
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.tracing import trace
from renderers.transport.photons.walk import smallest_radius, walk
from renderers.transport.photons.zones import GRADIENTS, Recipe, zones_of
from renderers.transport.raycast import caster_of
from renderers.transport.sampling import cosine_hemisphere, frame, lattice

F64 = np.ndarray
METHOD = PhotonMappedIrradianceCaching()
SIZE = (48, 36)
RNG = np.random.default_rng(20066)


def recipe(a: float = 0.3, smallest: float = 0.01, gradients: str = "off", estimator: int = 2) -> Recipe:
    return Recipe(a, smallest, 1.0, 50, 8, estimator, GRADIENTS[gradients], 500, 8, 24)


# --- cells and gradients -------------------------------------------------------------------------------------------------------


def formula_8(radiance: F64, distance: F64, join: Callable[[F64, F64], F64]) -> F64:
    """The translation gradient of equation 8, written out in numpy; radiance, distance (M, N); join: two distances to one."""
    rows, columns = radiance.shape
    sine = np.sqrt(np.arange(rows + 1) / rows)
    middle, edge = (np.arange(columns) + 0.5) * 2 * np.pi / columns, np.arange(columns) * 2 * np.pi / columns
    low = sine[1:-1, None]
    outward = 2 * np.pi / columns * low * (1 - low**2) * np.diff(radiance, axis=0) / join(distance[1:], distance[:-1])
    before = np.roll(radiance, 1, axis=1)
    across = np.diff(sine)[:, None] * (radiance - before) / join(distance, np.roll(distance, 1, axis=1))
    radial, sideways = outward.sum(axis=0), across.sum(axis=0)
    return np.array(
        [(np.cos(middle) * radial - np.sin(edge) * sideways).sum(), (np.sin(middle) * radial + np.cos(edge) * sideways).sum()]
    )


def both(radiance: F64, distance: F64) -> tuple[F64, F64]:
    """The kernel's gradients of one channel: translation, rotation (2,)."""
    along, turn = np.empty((3, 2)), np.empty((3, 2))
    gradients_of(np.repeat(radiance[..., None], 3, axis=2), distance, along, turn)
    return along[0], turn[0]


def in_cells(directions: F64, flux: F64, distance: F64, cells: tuple[int, int]) -> tuple[F64, F64, F64]:
    """Flux, harmonic mean distance (0 where empty) and hits of cells (M, N) of local directions (n, 3)."""
    power, inverse, hits = np.zeros((*cells, 3)), np.zeros(cells), np.zeros(cells, np.int64)
    u, v, w = (np.ascontiguousarray(c) for c in directions.T)
    cell_sums(u, v, w, np.repeat(flux[:, None], 3, axis=1), distance, len(u), *cells, power, inverse, hits)
    return power[..., 0], np.where(hits > 0, hits / np.where(hits > 0, inverse, 1), 0), hits


def test_kernel_says_what_formula_8_says_with_mean_distances() -> None:
    radiance, distance = RNG.random((8, 24)), 1 + RNG.random((8, 24))
    expected = formula_8(radiance, distance, lambda a, b: (a + b) / 2)
    assert both(radiance, distance)[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("cells", [(4, 12), (8, 24), (16, 48)])
def test_a8_a9_cells_add_up_to_the_irradiance(cells: tuple[int, int]) -> None:
    n = 20_000
    local = cosine_hemisphere(np.tile([0.0, 0.0, 1.0], (n, 1)), RNG.random((n, 2)))
    flux = RNG.random(n)
    power, _, hits = in_cells(local, flux, np.ones(n), cells)
    radiance = power * cells[0] * cells[1] / np.pi
    solid = np.pi / (cells[0] * cells[1])
    assert hits.sum() == n
    assert (radiance * solid).sum() == pytest.approx(flux.sum(), rel=1e-12)
    assert radiance.mean() == pytest.approx(flux.sum() / np.pi, rel=1e-12)


@pytest.mark.parametrize("cells", [(4, 12), (8, 24), (16, 48)])
def test_a10_h7_noise_of_gradients_in_uniform_light(cells: tuple[int, int]) -> None:
    """rms |∇|·scale/E = 2.1/√n ±20 %, whatever the grid."""
    n, trials = 400, 150
    sizes = []
    for _ in range(trials):
        local = cosine_hemisphere(np.tile([0.0, 0.0, 1.0], (n, 1)), RNG.random((n, 2)))
        power, _, _ = in_cells(local, np.full(n, 1 / n), np.ones(n), cells)
        along, turn = both(power * cells[0] * cells[1] / np.pi, np.ones(cells))
        sizes.append([along @ along, turn @ turn])
    law = 2.1 / np.sqrt(n)
    assert np.sqrt(np.mean(sizes, axis=0)) == pytest.approx([law, law], rel=0.2)


def test_a11_h8_rotation_gradient_of_a_half_lit_hemisphere() -> None:
    """Radiance 1 from u > 0, 0 from the other half: E = π/2, |∇_r| = π/2."""
    n = 200_000
    local = cosine_hemisphere(np.tile([0.0, 0.0, 1.0], (n, 1)), RNG.random((n, 2)))
    power, _, _ = in_cells(local, np.where(local[:, 0] > 0, np.pi / n, 0), np.ones(n), (8, 24))
    radiance = power * 8 * 24 / np.pi
    _, turn = both(radiance, np.ones((8, 24)))
    assert turn == pytest.approx([0, np.pi / 2], abs=0.01 * np.pi / 2)
    assert np.linalg.norm(turn) <= np.pi / 2 * radiance.max()


def photons_at(world: World, point: F64, normal: F64, n: int, spread: float = 0.0) -> tuple[F64, F64, F64]:
    """Local directions, flux and distances of photons that room 1's radiance sends to a disc of radius `spread`, metres.

    Only places of the disc that the point sees along the surface count: none behind a wall or under the box.
    """
    s, t = (v[0] for v in frame(normal[None]))
    random = lattice(n, 4)
    radius, phi = spread * np.sqrt(random[:, 2]), 2 * np.pi * random[:, 3]
    start = point + (radius * np.cos(phi))[:, None] * s + (radius * np.sin(phi))[:, None] * t
    start = (start - world.centre) * world.scale + 1e-3 * normal
    middle = np.tile((point - world.centre) * world.scale + 1e-3 * normal, (n, 1))
    free = ~caster_of(world).occluded(middle, start - middle, np.ones(n))
    start, random = start[free], random[free]
    local = cosine_hemisphere(np.tile([0.0, 0.0, 1.0], (len(start), 1)), random[:, :2])
    away = local[:, :1] * s + local[:, 1:2] * t + local[:, 2:] * normal
    hits = caster_of(world).first_hit(start, away)
    seen = hits.triangle >= 0
    at = metres(world, start[seen] + away[seen] * hits.t[seen, None])
    return local[seen], radiance_1(at) * np.pi / len(start), hits.t[seen].astype(np.float64) / world.scale


@pytest.fixture(scope="module")
def first_room() -> World:
    return room_1().world()


def projected(gradient: F64, normal: F64) -> F64:
    s, t = (v[0] for v in frame(normal[None]))
    return np.array([gradient @ s, gradient @ t])


def test_a12_formula_8_with_exact_cells_against_finite_differences(first_room: World) -> None:
    """Radiance and distance along the middle of each cell, the nearer of two: within 15 % of the differences of E over ±2 cm.

    32 × 96 cells: one ray for each of 16 × 48 is 18 % off at one of these points, by the box's edge falling between rays.
    """
    rows, columns = 32, 96
    j, k = (index.ravel() for index in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    sine, phi = np.sqrt((j + 0.5) / rows), 2 * np.pi * (k + 0.5) / columns
    for point, normal, _, expected, _ in POINTS_1[:6]:
        s, t = frame(normal[None])
        middle = (sine * np.cos(phi))[:, None] * s + (sine * np.sin(phi))[:, None] * t + np.sqrt(1 - sine**2)[:, None] * normal
        start = np.tile((point - first_room.centre) * first_room.scale + 1e-4 * normal, (len(middle), 1))
        hits = caster_of(first_room).first_hit(start, middle)
        radiance = radiance_1(metres(first_room, start + middle * hits.t[:, None]))
        distance = hits.t.astype(np.float64) / first_room.scale
        found = formula_8(radiance.reshape(rows, columns), distance.reshape(rows, columns), np.minimum)
        truth = projected(expected, normal)
        assert np.linalg.norm(found - truth) <= 0.15 * np.linalg.norm(truth), point


def zone_gradients(world: World, point: F64, normal: F64, expected: F64, share: float) -> tuple[float, float, float]:
    """Error and gain of the mean rule, and gain of the minimum, with 100 000 photons of a zone of radius `share` · h."""
    h = 1 / float(np.mean(1 / photons_at(world, point, normal, 20_000)[2]))
    local, flux, distance = photons_at(world, point, normal, 100_000, share * h)
    power, mean, _ = in_cells(local, flux, distance, (16, 48))
    radiance, filled, truth = power * 16 * 48 / np.pi, np.where(mean > 0, mean, h), projected(expected, normal)
    found, nearest = both(radiance, filled)[0], formula_8(radiance, filled, np.minimum)
    return np.linalg.norm(found - truth) / np.linalg.norm(truth), found @ truth / (truth @ truth), nearest @ truth / (truth @ truth)  # type: ignore[return-value]


def test_a13_gradients_of_photons_in_a_zone_of_the_default_accuracy(first_room: World) -> None:
    """Radius 0.3 h, as far as a record reaches: median error ≤ 35 %, median gain in [.8, 1.4].

    At h/2 zones of this room touch its walls and its box (h is up to 2.6 m of 4 m), and ways of no length take over.
    """
    errors, gains, _ = zip(*(zone_gradients(first_room, p, n, g, 0.3) for p, n, _, g, _ in POINTS_1[:6]), strict=True)
    assert np.median(errors) <= 0.35
    assert 0.8 <= np.median(gains) <= 1.4


def test_a14_the_minimum_of_distances_exaggerates(first_room: World) -> None:
    """Radius h/2: median gain of the minimum > 1.5, and twice that of the mean."""
    _, mean, nearest = zip(*(zone_gradients(first_room, p, n, g, 0.5) for p, n, _, g, _ in POINTS_1[:6]), strict=True)
    assert np.median(nearest) > 1.5
    assert np.median(nearest) > 2 * np.median(mean)


# --- the walk ------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def box_world() -> World:
    return photon_box().world()


@pytest.fixture(scope="module")
def box_map(box_world: World) -> PhotonMap:
    return photon_map(trace(box_world, 50_000, seed=3))


def walked(world: World, photons: PhotonMap, **changes: object) -> object:
    made = recipe(smallest=smallest_radius(world, photons, 0.3))
    return walk(world, photons, made, **changes)  # type: ignore[arg-type]


def test_a15_every_photon_is_covered_after_the_walk(box_world: World, box_map: PhotonMap) -> None:
    cache = walked(box_world, box_map)
    records, p = cache.records, box_map.photons
    least = np.full(len(p), np.inf)
    for k in range(len(records)):
        distance = np.linalg.norm(p.position - records.position[k], axis=1) / records.radius[k]
        least = np.minimum(least, distance + np.linalg.norm(p.normal - records.normal[k], axis=1) / np.sqrt(2))
    assert (least <= 0.3 * (1 + 1e-5)).all()
    assert 200 < len(records) < len(p) / 10


def test_the_batched_walk_is_the_sequential_one(box_world: World, box_map: PhotonMap) -> None:
    one, many = walked(box_world, box_map, batch=1), walked(box_world, box_map, batch=64)
    for name in ("position", "radius", "irradiance"):
        assert getattr(one.records, name).tobytes() == getattr(many.records, name).tobytes()


def test_a16_the_order_of_the_walk_hardly_changes_the_number_of_records(box_world: World, box_map: PhotonMap) -> None:
    backwards = replace(box_map, order=len(box_map) - 1 - box_map.order)
    forward, backward = len(walked(box_world, box_map).records), len(walked(box_world, backwards).records)
    assert backward == pytest.approx(forward, rel=0.06)


def test_a25_same_bytes_at_any_thread_count() -> None:
    scene, settings = photon_box(), PmicSettings(photons=20_000)
    image = METHOD.render(scene, settings, size=(16, 12), seed=5).layers["beauty"].tobytes()
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        assert METHOD.render(scene, settings, size=(16, 12), seed=5).layers["beauty"].tobytes() == image
    finally:
        numba.set_num_threads(threads)
    assert METHOD.render(scene, settings, size=(16, 12), seed=6).layers["beauty"].tobytes() != image


def test_zones_of_uniform_light_hold_its_irradiance() -> None:
    photons = on_plane(RNG.random((200_000, 2)), distance=0.2)
    inner = np.flatnonzero((np.abs(photons.photons.position[:, :2] - 0.5) < 0.4).all(axis=1))[::100]
    p = photons.photons
    where = Points(p.position[inner].astype(float), p.normal[inner].astype(float), np.full(len(inner), 0.02))
    zones = zones_of(photons, where, inner, recipe())
    assert zones.radius == pytest.approx(np.full(len(inner), 0.2), rel=1e-5)
    assert zones.irradiance[:, 0].mean() == pytest.approx(1.0, abs=0.005)
    n = 200_000 * np.pi * (0.3 * 0.2) ** 2
    assert zones.irradiance[:, 0].std() == pytest.approx(1 / np.sqrt(n), rel=0.25)


# --- images --------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def truth() -> F64:
    """Indirect radiance of the box by path tracing; its noise is about 2 % a pixel."""
    pt, scene = renderers.get_method("pt"), photon_box()
    full = pt.render(scene, pt.Settings(spp=4096), size=SIZE).layers["beauty"]
    direct = pt.render(scene, pt.Settings(transport="direct", spp=16), size=SIZE).layers["beauty"]
    return (full.astype(np.float64) - direct)[..., 0]


def rmse(truth: F64, method: str = "pmic", **settings: object) -> float:
    m = renderers.get_method(method)
    image = m.render(photon_box(), m.Settings(**settings), size=SIZE, seed=1).layers["indirect"][..., 0]
    return float(np.sqrt(np.mean((image - truth) ** 2)) / truth.mean())


@pytest.mark.mitsuba
def test_c1_a_third_of_the_error_of_direct_visualisation_at_400_000_photons(truth: F64) -> None:
    cached, shown = rmse(truth), rmse(truth, "photon-map", photons=400_000)
    assert cached <= shown / 3


@pytest.mark.mitsuba
def test_a18_a19_more_photons_are_better_and_so_is_the_correction(truth: F64) -> None:
    errors = {
        n: [rmse(truth, photons=n, area=area, gradients="off") for area in ("corrected", "hull")]
        for n in (25_000, 100_000, 400_000)
    }
    corrected = [errors[n][0] for n in errors]
    assert corrected[0] > corrected[1] > corrected[2]
    assert all(right <= raw for right, raw in errors.values())


@pytest.mark.mitsuba
@pytest.mark.parametrize("a", [0.3, 0.5])
def test_a20_c8_gradients_lower_the_error(truth: F64, a: float) -> None:
    off = rmse(truth, a=a, gradients="off")
    assert rmse(truth, a=a, gradients="shrunk") < off
    assert rmse(truth, a=a, gradients="thresholded") <= off * 1.01


@pytest.mark.mitsuba
def test_a23_c4_the_energy_is_that_of_all_bounces(truth: F64) -> None:
    frame = METHOD.render(photon_box(), PmicSettings(), size=SIZE, seed=2)
    assert frame.layers["indirect"][..., 0].mean() == pytest.approx(truth.mean(), rel=0.02)


def test_a24_c5_another_camera_makes_no_record() -> None:
    scene = photon_box()
    camera = scene.world().camera
    pose = camera.pose.copy()
    pose[:3, 3] += 0.1 * pose[:3, 0]
    frames = METHOD.walkthrough(scene, PmicSettings(photons=50_000), [camera, WorldCamera(pose, camera.yfov)], size=(24, 18))
    single = METHOD.render(scene, PmicSettings(photons=50_000), size=(24, 18))
    assert frames[0].layers["beauty"].tobytes() == single.layers["beauty"].tobytes()
    assert frames[0].counters["records"] > 0
    assert {"records", "zones", "photons_emitted"}.isdisjoint(frames[1].counters)
    assert not [t for t in frames[1].timings if t.stage == "prepare"]
    assert frames[1].layers["beauty"].tobytes() != frames[0].layers["beauty"].tobytes()


def test_c6_the_order_of_two_thousand_records_at_half_a_million_photons(box_world: World) -> None:
    photons = photon_map(trace(box_world, 400_000, seed=1))
    counters = Counter[str]()
    walk(box_world, photons, recipe(a=0.3, smallest=smallest_radius(box_world, photons, 0.3)), counters=counters)
    assert 400_000 < len(photons) < 600_000
    assert 1000 < counters["records"] < 5000
    assert counters["zones"] < 1.1 * counters["records"]


def test_c7_holes_vanish_with_photons() -> None:
    counts = [
        METHOD.render(photon_box(), PmicSettings(photons=n), size=(32, 24)).counters["pixels_missed"] for n in (500, 5_000, 100_000)
    ]
    assert counts[0] > counts[1] > counts[2]
    assert counts[2] <= 2


def test_every_pixel_its_own_record_and_holes_black() -> None:
    scene = photon_box()
    each = METHOD.render(scene, PmicSettings(photons=20_000, records="pixels"), size=(16, 12))
    assert each.counters["pixels_missed"] == each.counters["pixels_covered"]
    black = METHOD.render(scene, PmicSettings(photons=50, holes="black"), size=(16, 12))
    filled = METHOD.render(scene, PmicSettings(photons=50, holes="fill"), size=(16, 12))
    assert np.count_nonzero(black.layers["indirect"]) < np.count_nonzero(filled.layers["indirect"])


def test_gathering_is_that_of_the_peer_and_makes_no_cache() -> None:
    scene = photon_box()
    settings = PmicSettings(photons=20_000, records="gather", gather_rays=4)
    ours = METHOD.render(scene, settings, size=(16, 12), seed=3)
    peer = renderers.get_method("photon-map-final-gather")
    theirs = peer.render(scene, peer.Settings(photons=20_000, rays=4), size=(16, 12), seed=3)
    assert ours.layers["indirect"].tobytes() == theirs.layers["indirect"].tobytes()
    assert "records" not in ours.counters
    with pytest.raises(ValueError, match="no cache"):
        METHOD.walkthrough(scene, settings, [scene.world().camera], size=(16, 12))


def test_diagnostic_pictures_hold_photons_and_records() -> None:
    frame = METHOD.render(photon_box(), PmicSettings(photons=20_000), size=(24, 18))
    assert set(frame.captions) == {"debug.photons", "debug.records"}
    assert all(frame.layers[name].max() > 0.5 for name in frame.captions)


def test_points_know_curved_surfaces() -> None:
    world = renderers.load_scene("cornell-box").world()
    assert (points(world, np.zeros((3, 3)), np.zeros((3, 3)), np.arange(3)).slab == 0.02).all()


def test_progressive_refinement_converges_to_the_mean_of_many_photons(box_world: World) -> None:
    """16 rounds of 20 000 photons, zones of 50 and shrinking: under half of one round's error against a million photons."""
    from renderers.transport.photons.density import irradiance, lookup
    from renderers.transport.photons.refine import refined

    photons = photon_map(trace(box_world, 20_000, seed=4))
    cache = walk(box_world, photons, recipe(smallest=smallest_radius(box_world, photons, 0.3))._replace(n_min=50))
    many = photon_map(trace(box_world, 1_000_000, seed=99))
    where = points(box_world, cache.records.position, cache.records.normal, photons.photons.triangle[cache.photon])
    exact = irradiance(many, where, lookup(400, 0.1, "corrected")).mean(axis=1)

    def error(rounds: int) -> float:
        found = refined(box_world, photons, cache, 2, 4, rounds).records.irradiance.mean(axis=1)
        # the 400 photons of the truth have a variance of their own
        return float(np.sqrt(np.mean((found - exact) ** 2) / exact.mean() ** 2 - 1 / 400))

    errors = [error(rounds) for rounds in (1, 4, 16)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < errors[0] / 2
