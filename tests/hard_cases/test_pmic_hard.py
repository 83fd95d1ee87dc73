"""Where photon-mapped irradiance caching can go wrong (hard cases by number), and what it must do there."""

from __future__ import annotations

import numpy as np
import pytest
from photon_rooms import flat, made, on_plane, photon_box

from renderers.methods.photon_map import PhotonMapping, PhotonMapSettings
from renderers.methods.pmic import PhotonMappedIrradianceCaching, PmicSettings
from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box, flipped
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.world import World
from renderers.transport.photons.density import Points, irradiance, lookup
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.tracing import trace
from renderers.transport.photons.walk import Cache, smallest_radius, walk
from renderers.transport.photons.zones import GRADIENTS, Recipe, Zones, zones_of

METHOD = PhotonMappedIrradianceCaching()
SIZE = (24, 18)
RNG = np.random.default_rng(7)
WORLD = photon_box().world()


def recipe(a: float = 0.3, smallest: float = 0.01, gradients: str = "off") -> Recipe:
    return Recipe(a, smallest, 1.0, 50, 8, 2, GRADIENTS[gradients], 500, 8, 24)


def zone(photons: PhotonMap, place: tuple[float, float, float], normal: tuple[float, float, float], made_by: Recipe) -> Zones:
    """One zone that is no photon's own."""
    where = Points(np.array([place], float), np.array([normal], float), np.full(1, 0.02))
    return zones_of(photons, where, np.full(1, -1), made_by)


def image(scene: Scene, seed: int = 1, **settings: object) -> np.ndarray:
    return METHOD.render(scene, PmicSettings(**settings), size=SIZE, seed=seed).layers["indirect"]  # type: ignore[arg-type]


def room(albedo: float, lamp: bool = True, inside: bool = False) -> Scene:
    """Closed box; inside: the lamp is sealed in a smaller closed box."""
    b = SceneBuilder("room")
    wall = b.material(Lambert("wall", (albedo,) * 3))
    b.place(flipped(box((-1, -1, -1), (1, 1, 1))), wall, "room")
    if inside:
        b.place(box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2)), wall, "cell")
    if lamp:
        b.light(PointLight("lamp"), (0.05, 0.02, 0.01))
    b.camera((0.6, 0.6, 0.9), (0, 0, 0), 1.2)
    return b.build()


def test_h6_a_room_that_photons_never_reach_is_black_with_a_reason() -> None:
    frame = METHOD.render(room(0.5, inside=True), PmicSettings(photons=20_000), size=SIZE)
    assert not frame.layers["beauty"].any()
    assert frame.counters["pixels_without_photons"] == frame.counters["pixels_covered"]
    assert "no photon" in frame.notes[0]


def test_h6_a_scene_without_light_is_black_with_a_reason() -> None:
    frame = METHOD.render(room(0.5, lamp=False), PmicSettings(photons=1000), size=SIZE)
    assert not frame.layers["beauty"].any()
    assert frame.counters["records"] == 0
    assert "no light" in frame.notes[0]


def test_black_walls_have_direct_light_only() -> None:
    frame = METHOD.render(room(0.0), PmicSettings(photons=1000), size=SIZE)
    assert frame.layers["direct"].max() == 0
    assert not frame.layers["indirect"].any()


def test_h19_walls_that_absorb_almost_nothing_stay_finite_and_have_their_energy() -> None:
    """Albedo .98: 49 reflections in the mean. Indirect flux on the walls is 49 times the lamp's."""
    world = room(0.98).world()
    traced = trace(world, 4000, seed=1)
    assert traced.photons.flux.astype(np.float64).sum(axis=0) == pytest.approx(
        49 * traced.flux, rel=0.06
    )  # 1/√4000 · √(.98)/.02/49
    found = METHOD.render(room(0.98), PmicSettings(photons=4000), size=SIZE).layers["indirect"]
    assert found.min() > 0
    exact = 0.98 / np.pi * 49 * 4 * np.pi / 24
    assert found.mean() == pytest.approx(exact, rel=0.1)


@pytest.mark.parametrize("photons", [1, 2, 3, 10])
def test_a_handful_of_photons(photons: int) -> None:
    frame = METHOD.render(photon_box(), PmicSettings(photons=photons), size=SIZE)
    assert np.isfinite(frame.layers["beauty"]).all()
    shown = PhotonMapping().render(photon_box(), PhotonMapSettings(photons=photons, area="corrected"), size=SIZE)
    assert np.isfinite(shown.layers["beauty"]).all()


def test_h1_h16_photons_on_a_line_or_in_one_place() -> None:
    line = np.stack([np.linspace(0, 1, 500), np.full(500, 0.5)], axis=1)
    heap = np.full((500, 2), 0.5)
    for xy in (line, heap, np.concatenate([line, heap])):
        photons = on_plane(xy)
        cache = walk(WORLD, photons, recipe())
        assert 1 <= len(cache.records) <= 500
        assert np.isfinite(cache.records.irradiance).all()
        assert len(np.unique(cache.records.position, axis=0)) == len(cache.records)


def lit(region: object, photons: int = 200_000, r: float = 0.5, place: tuple[float, float] = (0.0, 0.0)) -> float:
    """E at `place` over the density of photons that are uniform on [-1, 1]² where `region(x, y)` holds, from a zone of radius r."""
    xy = RNG.random((photons, 2)) * 2 - 1
    kept = on_plane(xy[region(xy[:, 0], xy[:, 1])], flux=1.0, distance=1.0)  # type: ignore[operator]
    found = zone(kept, (*place, 0.0), (0, 0, 1), Recipe(r, 0.01, 1.0, 50, 8, 2, 0, 500, 8, 24))
    assert found.reach[0] == pytest.approx(r)
    return float(found.irradiance[0, 0] / (photons / 4))


def test_h3_the_hull_fills_in_what_is_not_convex() -> None:
    """The light of a region is spread over its convex cover, less than the disc by what no photon can show.

    Outer corner: ¾ π of the disc; its cover adds the triangle ½ between the arc's ends. A hole of 0.4 r: 1 - 0.16. A strip of
    ±0.2 r: 1 - 2 (0.2 √0.96 + asin 0.2) / π.
    """
    assert lit(lambda x, y: (x > 0) | (y > 0)) == pytest.approx(0.75 * np.pi / (0.75 * np.pi + 0.5), abs=0.02)
    assert lit(lambda x, y: x * x + y * y > 0.2**2) == pytest.approx(0.84, abs=0.02)
    assert lit(lambda x, y: abs(x) > 0.1) == pytest.approx(1 - 2 * (0.2 * np.sqrt(0.96) + np.arcsin(0.2)) / np.pi, abs=0.02)


def test_h4_a_shadow_edge_looks_like_a_border() -> None:
    assert lit(lambda x, y: x > 0) == pytest.approx(1.0, abs=0.02)


def test_h5_beside_a_dark_block_the_radius_is_too_large() -> None:
    """The dark side sends no photons: R from photons is well beyond the ray-cast cosine-weighted mean, as documented."""
    from renderers.transport.raycast import caster_of
    from renderers.transport.sampling import cosine_hemisphere

    b = SceneBuilder("dark block")
    grey, black = b.material(Lambert("g", (0.5,) * 3)), b.material(Lambert("b", (0.0,) * 3))
    b.place(flipped(box((-1, -1, 0), (1, 1, 2))), grey, "room")
    b.place(box((0.1, -0.5, 0), (0.6, 0.1, 0.7)), black, "block")
    b.light(PointLight("lamp"), (0, 0, 1.6))
    b.camera((-0.9, -0.9, 1.9), (0, 0, 0), 1.2, (0, 0, 1))
    world = b.build().world()
    photons = photon_map(trace(world, 300_000, seed=1))
    place = (np.array([0.65, -0.2, 0.0]) - world.centre) * world.scale
    found = zone(photons, tuple(place), (0, 0, 1), recipe())  # type: ignore[arg-type]
    directions = cosine_hemisphere(np.tile([0.0, 0.0, 1.0], (4096, 1)), RNG.random((4096, 2)))
    hits = caster_of(world).first_hit(np.tile(place + np.array([0, 0, 1e-4]), (4096, 1)), directions)
    cast = 1 / np.mean(1 / hits.t.astype(np.float64))
    assert found.radius[0] / cast > 1.5


def test_h10_two_sided_sheets_keep_their_sides_apart() -> None:
    """A sheet lit with 1 from above and 2 from below: each side finds its own, and without normals it would be 3."""
    xy = RNG.random((60_000, 2))
    up = np.tile([0.0, 0.0, 1.0], (60_000, 1))
    position = np.concatenate([xy, np.zeros((60_000, 1))], axis=1)
    flux = np.concatenate([np.full(60_000, 1.0), np.full(60_000, 2.0)]) / 60_000
    photons = made(np.concatenate([position, position]), np.concatenate([up, -up]), flux=flux)
    x, y = 0.2 + 0.6 * RNG.random((2, 200))
    above = flat(x, y)
    for side, level in ((1, 1.0), (-1, 2.0)):
        found = irradiance(photons, Points(above.position, side * above.normal, above.slab), lookup(0, 0.05, "corrected"))
        assert found[:, 0].mean() == pytest.approx(level, rel=0.02)


def test_h18_crossing_walls_and_corners_do_not_leak() -> None:
    """Floor lit with 1, wall with 5, crossing in the line x = 0: a place on either finds its own light up to the corner."""
    u, v = RNG.random((2, 100_000)) - 0.5
    zero = 0 * u
    floor, wall = np.stack([u, v, zero], axis=1), np.stack([zero, v, np.abs(u)], axis=1)
    n_floor, n_wall = np.tile([0.0, 0.0, 1.0], (100_000, 1)), np.tile([1.0, 0.0, 0.0], (100_000, 1))
    flux = np.concatenate([np.full(100_000, 1.0), np.full(100_000, 2.5)]) / 100_000
    photons = made(np.concatenate([floor, wall]), np.concatenate([n_floor, n_wall]), flux=flux)
    along = np.linspace(-0.4, 0.4, 200)
    near = np.full(200, 0.002)
    for position, normal, level in (
        (np.stack([near, along, 0 * near], axis=1), n_floor[:200], 1.0),
        (np.stack([0 * near, along, near], axis=1), n_wall[:200], 5.0),
    ):
        found = irradiance(photons, Points(position, normal, np.full(200, 0.02)), lookup(0, 0.04, "corrected"))
        assert found[:, 0].mean() == pytest.approx(level, rel=0.02)


def test_light_stays_within_the_documented_radius_behind_a_partition() -> None:
    """A thin wall across the box; the dark half gets no indirect light: every record that reaches it sits there, on no photon."""
    b = SceneBuilder("partition")
    grey = b.material(Lambert("g", (0.5,) * 3))
    b.place(flipped(box((-1, -1, 0), (1, 1, 2))), grey, "room")
    b.place(box((-0.01, -1, 0), (0.01, 1, 2)), grey, "partition")
    b.light(PointLight("lamp"), (0.5, 0, 1))
    b.camera((-0.9, 0, 1), (0, 0, 0.9), 1.4, (0, 0, 1))
    scene = b.build()
    frame = METHOD.render(scene, PmicSettings(photons=50_000, holes="black"), size=SIZE)
    world = scene.world()
    photons = photon_map(trace(world, 50_000, seed=0))
    assert (photons.photons.position[:, 0] / world.scale + world.centre[0] > 0).all()
    # the floor's records from the lit half may reach a·R past the partition: pixels farther than that from it are black
    from renderers.transport.primary import cast_gbuffer

    gbuffer = cast_gbuffer(world, SIZE)
    x = gbuffer.position[..., 0] / world.scale + world.centre[0]
    reach = 0.3 / world.scale  # a · r_max
    assert not frame.layers["indirect"][x < -0.01 - reach].any()
    facing = np.abs(gbuffer.normal[..., 0]) > 0.9
    assert not frame.layers["indirect"][facing].any()


@pytest.mark.parametrize("size", [1e-3, 1e4])
def test_scale_of_lengths_does_not_matter(size: float) -> None:
    """Lengths × s and intensity × s²: the same image, but for single paths that float32 sends elsewhere."""
    usual, other = image(photon_box(), photons=20_000), image(photon_box(size=size), photons=20_000)
    assert other.mean() == pytest.approx(usual.mean(), rel=0.02)
    assert np.median(np.abs(other - usual)) < 1e-3 * usual.mean()


def test_h15_far_from_the_origin() -> None:
    near, far = (cache_of(photon_box(shift=shift).world()) for shift in ((0, 0, 0), (1000, -1000, 1000)))
    assert len(far.records) == pytest.approx(len(near.records), rel=0.03)
    assert np.median(far.records.irradiance) == pytest.approx(np.median(near.records.irradiance), rel=0.05)


def cache_of(world: World, a: float = 0.3, gradients: str = "off") -> Cache:
    photons = photon_map(trace(world, 40_000, seed=2))
    return walk(world, photons, recipe(a, smallest_radius(world, photons, a), gradients))


def test_h17_a_at_and_beyond_one_needs_few_records() -> None:
    counts = [len(cache_of(WORLD, a).records) for a in (0.5, 1.0, 1.3)]
    assert counts[0] > counts[1] > counts[2] > 5


def test_h9_radii_in_corners_have_a_floor() -> None:
    photons = photon_map(trace(WORLD, 40_000, seed=2))
    smallest = smallest_radius(WORLD, photons, 0.3)
    radius = walk(WORLD, photons, recipe(0.3, smallest)).records.radius
    assert radius.min() == pytest.approx(smallest)
    assert radius.max() <= 1.0


@pytest.mark.parametrize("gradients", ["thresholded", "shrunk"])
def test_h20_extrapolation_never_turns_negative(gradients: str) -> None:
    cache = cache_of(WORLD, 0.5, gradients)
    steepness = np.linalg.norm(cache.records.translation, axis=2) * cache.records.radius[:, None]
    assert (steepness <= cache.records.irradiance * (1 + 1e-9)).all()
    assert image(photon_box(), photons=40_000, a=0.5, gradients=gradients).min() >= 0


@pytest.mark.slow
def test_ten_million_photons_stay_within_the_memory_bound() -> None:
    traced = trace(WORLD, 12_000_000, seed=1, most_stored=10_000_000)
    photons = photon_map(traced)
    assert 10_000_000 <= len(photons) < 10_300_000
    assert photons.bytes < 72 * len(photons)
