"""Photon maps against closed forms: energy, emission of every light, density estimation and its boundary bias."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from photon_rooms import flat, made, on_plane
from scipy.integrate import quad
from scipy.special import comb

import renderers
from renderers.images import read_exr
from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.builtin.solids import box, flipped
from renderers.scene.model import (
    GGX,
    DirectionalLight,
    Environment,
    Lambert,
    Phong,
    PointLight,
    Scene,
    SpotLight,
)
from renderers.scene.shapes import sphere
from renderers.scene.world import World
from renderers.transport.direct import irradiance as direct_irradiance
from renderers.transport.photons.density import Points, irradiance, lookup
from renderers.transport.photons.hull import CORRECTED, DISC, hull_area, sampled_area
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.picture import photon_picture, pixels_of, record_picture
from renderers.transport.photons.tracing import Photons, trace
from renderers.transport.photons.zones import Recipe, zones_of
from renderers.transport.primary import cast_gbuffer

RNG = np.random.default_rng(20061)


def room(*materials: object) -> World:
    """Closed box 2 × 2 × 2 with a point light of 1 W in the centre; one material, or one for each of its shells."""
    b = SceneBuilder("room")
    b.place(flipped(box((-1, -1, -1), (1, 1, 1))), b.material(materials[0]), "room")  # type: ignore[arg-type]
    b.light(PointLight("lamp", intensity=1 / (4 * np.pi)))
    b.camera((0.5, 0.5, 0.9), (0, 0, 0), 1.0)
    return b.build().world()


def total(photons: Photons) -> np.ndarray:
    return photons.flux.astype(np.float64).sum(axis=0)


def uniform_plane(count: int) -> PhotonMap:
    """`count` photons of flux 1/count, uniform on a square of area 1: irradiance 1."""
    return on_plane(RNG.random((count, 2)))


def test_a1_a_closed_box_stores_its_flux_over_one_minus_albedo() -> None:
    world = room(Lambert("grey", albedo=(0.5, 0.5, 0.5)))
    traced = trace(world, 200_000, seed=1, direct=True)
    assert total(traced.photons) == pytest.approx(2 * traced.flux, rel=5e-3)
    assert traced.flux == pytest.approx(np.full(3, world.scale**2), rel=1e-6)


def test_a2_and_h13_channels_of_a_coloured_sphere_keep_their_energy() -> None:
    b = SceneBuilder("sphere")
    albedo = np.array([0.6, 0.5, 0.2])
    wall = b.material(Lambert("wall", albedo=tuple(albedo)))
    b.place(flipped(sphere(1.0, 96, 48)), wall)
    b.light(PointLight("lamp", intensity=1.0))
    b.camera((0, 0, 0.5), (0, 0, -1), 1.0)
    traced = trace(b.build().world(), 400_000, seed=2, direct=True)
    assert total(traced.photons) / traced.flux == pytest.approx(1 / (1 - albedo), rel=5e-3)
    indirect = traced.photons.bounce > 0
    assert total(traced.photons.rows(indirect)) / traced.flux == pytest.approx(albedo / (1 - albedo), rel=5e-3)


def test_a3_harmonic_mean_of_the_way_in_a_sphere_is_its_radius() -> None:
    world = renderers.load_scene("sphere-in-sphere", source="point", albedo=0.6).world()
    photons = trace(world, 100_000, seed=3).photons
    assert 1 / np.mean(1 / photons.distance.astype(np.float64)) / world.scale == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("material", [Phong("p", (0.3,) * 3, (0.4,) * 3, 30.0), GGX("g", (0.8,) * 3, 0.5, 0.5)])
def test_glossy_walls_reflect_what_their_brdf_says(material: object) -> None:
    """Second hits carry Φ · albedo of the wall's BRDF, measured by quadrature over the first hits' directions."""
    from renderers.transport.brdf import evaluate, materials_at
    from renderers.transport.sampling import lattice, uniform_sphere

    world = room(material)
    photons = trace(world, 60_000, seed=4, direct=True).photons
    first = photons.rows(photons.bounce == 0)
    some = first.rows(slice(0, None, 100))
    directions = uniform_sphere(lattice(4096, 2))
    expected = np.zeros(3)
    m = materials_at(world.materials, np.zeros(1, np.int32), world.materials.base[:1])
    for came, n, flux in zip(some.direction, some.normal, some.flux, strict=True):
        tile = (np.tile(np.asarray(v, np.float64), (4096, 1)) for v in (n, came))
        n4, v4 = tile
        f = evaluate(m.rows(np.zeros(4096, np.intp)), n4, directions, v4) * np.maximum(directions @ n, 0)[:, None]
        expected += f.mean(axis=0) * 4 * np.pi * flux
    second = total(photons.rows(photons.bounce == 1)) / total(first)
    # 600 directions of incidence and 60 000 photons: both sides within about 1 %
    assert second == pytest.approx(expected / total(some), rel=0.03)


def lit_floor(kind: str) -> Scene:
    """A black floor 2 × 2 and one light of a kind."""
    b = SceneBuilder(kind)
    floor = b.material(Lambert("floor", albedo=(0, 0, 0)))
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], floor)
    down = look_rotation(np.array([0.2, -1.0, 0.1]))
    if kind == "point":
        b.light(PointLight("l", (1.0, 0.5, 0.2)), (0.2, 0.7, 0.1))
    elif kind == "spot":
        b.light(SpotLight("l", inner_angle=0.2, outer_angle=0.6), (0, 1.5, 0), down)
    elif kind == "sun":
        b.light(DirectionalLight("l"), rotation=down)
    elif kind in ("area", "both sides"):
        lamp = b.material(Lambert("lamp", albedo=(0, 0, 0), emission=(1, 2, 3), double_sided=kind == "both sides"))
        b.quad([(-0.3, 0.8, -0.3), (0.3, 0.8, -0.3), (0.3, 0.8, 0.3), (-0.3, 0.8, 0.3)], lamp)
    elif kind == "sky":
        b.environment = Environment((0.5, 1.0, 2.0))
    else:
        image = np.zeros((8, 16, 3), np.float32)
        image[1:4] = RNG.random((3, 16, 1)).astype(np.float32) ** 3
        b.environment = Environment((1.0, 2.0, 1.0), image)
    b.camera((0, 2, 2), (0, 0, 0), 1.0)
    return b.build()


@pytest.mark.parametrize("kind", ["point", "spot", "sun", "area", "both sides", "sky", "image"])
def test_a4_photons_of_every_light_bring_the_irradiance_that_sampling_it_does(kind: str) -> None:
    """20 points of the floor: k photons within a disc have a relative standard error 1/√k; χ² over the points, by channel sums."""
    world = lit_floor(kind).world()
    photons = photon_map(trace(world, 400_000, seed=5, direct=True))
    x, z = (RNG.random((2, 20)) - 0.5) * (0.3 if kind == "spot" else 1.2)
    position = np.stack([x, np.full(20, -0.0), z], axis=1) * world.scale + (-world.centre * world.scale) * [1, 1, 1]
    up = np.tile([0.0, 1.0, 0.0], (20, 1))
    exact = direct_irradiance(world, position, up, up, 1024, 1).sum(axis=1)
    radius = 0.03
    found = irradiance(photons, Points(position, up, np.full(20, 0.02)), lookup(0, radius)).sum(axis=1)
    per_photon = photons.photons.flux.astype(np.float64).sum(axis=1)
    typical = (per_photon**2).mean() / per_photon.mean()  # Poisson: variance of ΣΦ is ΣΦ²
    error = np.sqrt(exact * typical / (np.pi * radius**2))
    chi2 = np.sum(((found - exact) / error) ** 2)
    # 20 degrees of freedom: mean 20, standard deviation 6.3
    assert chi2 < 20 + 4 * 6.4
    assert found.mean() == pytest.approx(exact.mean(), abs=4 * float(np.sqrt(np.mean(error**2) / 20)))


def expected_hull_share(n: int) -> float:
    """Equation 5: mean area of the hull of n uniform points of a disc, over the disc's, by Efron's identity."""

    def below(s: float) -> float:
        return (np.arccos(s) - s * np.sqrt(1 - s * s)) / np.pi

    def edge(s: float, m: int) -> float:
        sigma = below(s)
        return float(16 / (3 * np.pi) * (1 - s * s) ** 1.5 * (sigma ** (m - 2) + (1 - sigma) ** (m - 2)))

    vertices = comb(n + 1, 2) * quad(edge, 0, 1, args=(n + 1,), limit=200)[0]
    return float(1 - vertices / (n + 1))


def disc_points(count: int, shape: str = "disc") -> np.ndarray:
    points = np.zeros((0, 2))
    while len(points) < count:
        p = RNG.random((4 * count, 2)) * 2 - 1
        keep = (p**2).sum(axis=1) < 1
        keep &= {"disc": True, "cut": p[:, 0] < 0.3, "half": p[:, 0] < 0, "quarter": (p < 0).all(axis=1)}[shape]
        points = np.concatenate([points, p[keep]])
    return points[:count]


SHAPES = {"disc": np.pi, "half": np.pi / 2, "quarter": np.pi / 4, "cut": np.pi - (np.arccos(0.3) - 0.3 * np.sqrt(1 - 0.09))}


@pytest.mark.parametrize(("n", "trials"), [(10, 6000), (50, 3000), (500, 600)])
def test_a5_mean_hull_of_uniform_points_has_its_closed_form(n: int, trials: int) -> None:
    areas = np.array([hull_area(*disc_points(n).T.copy(), n)[0] for _ in range(trials)]) / np.pi
    error = areas.std() / np.sqrt(trials)
    assert areas.mean() == pytest.approx(expected_hull_share(n), abs=max(4 * error, 1e-4))
    assert 4 * error < 0.012


def test_a7_asymptote_of_the_missing_share() -> None:
    n = 2000
    assert (1 - expected_hull_share(n)) * n ** (2 / 3) == pytest.approx(3.383, rel=0.01)


@pytest.mark.parametrize("shape", list(SHAPES))
@pytest.mark.parametrize("n", [20, 50, 100, 500])
def test_a6_corrected_hull_finds_the_area_of_any_convex_shape(shape: str, n: int) -> None:
    trials = 1500 if n < 500 else 300
    # radius 3: the disc doesn't cap the estimate
    areas = [sampled_area(*disc_points(n, shape).T.copy(), n, 3.0, CORRECTED) for _ in range(trials)]
    # 3000 trials at n = 20 have a standard error of .17/√3000 = 0.3 %; 1500 of 0.45 %
    assert np.mean(areas) == pytest.approx(SHAPES[shape], rel=0.01)


def test_hull_agrees_with_qhull() -> None:
    from scipy.spatial import ConvexHull

    for n in (3, 4, 10, 33, 100, 1000):
        points = RNG.normal(size=(n, 2))
        hull = ConvexHull(points)
        area, vertices = hull_area(*points.T.copy(), n)
        assert area == pytest.approx(hull.volume, rel=1e-12)
        assert vertices == len(hull.vertices)


def test_h1_degenerate_points_fall_back_to_the_disc() -> None:
    line = np.linspace(0, 1, 50)
    for x, y in ((line, 2 * line), (np.ones(50), line), (np.zeros(50), np.zeros(50)), (line[:2], line[:2]), (line[:0], line[:0])):
        assert sampled_area(x.copy(), y.copy(), len(x), 0.5, CORRECTED) == pytest.approx(np.pi / 4)


def test_a17_boundary_bias_under_one_percent_where_the_disc_loses_a_fifth() -> None:
    photons, r = uniform_plane(400_000), 0.03
    x, y = RNG.random(3000) * r, r + RNG.random(3000) * (1 - 2 * r)
    mean = {area: irradiance(photons, flat(x, y), lookup(0, r, area))[:, 0].mean() for area in ("disc", "hull", "corrected")}
    assert mean["disc"] == pytest.approx(1 - 2 / (3 * np.pi), abs=0.01)  # mean share of a disc beyond a line through it: 0.2122
    assert mean["corrected"] == pytest.approx(1.0, abs=0.01)
    assert mean["hull"] > 1.015


def test_irradiance_of_a_lit_plane_is_exact_in_the_limit() -> None:
    """k nearest: relative error 1/√k at fixed k / N^⅔, and no bias beyond it."""
    errors = []
    for count, k in ((4_000, 16), (32_000, 64), (256_000, 256)):
        photons = uniform_plane(count)
        x, y = 0.3 + 0.4 * RNG.random((2, 400))
        found = irradiance(photons, flat(x, y), lookup(k, 0.2))[:, 0]
        assert found.mean() == pytest.approx(1.0, abs=4 / np.sqrt(k * 100))
        errors.append(found.std())
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.25)
    assert errors[2] == pytest.approx(errors[1] / 2, rel=0.25)


def test_a21_k_nearest_has_no_bias() -> None:
    x, y = 0.2 + 0.6 * RNG.random((2, 4000))
    photons = uniform_plane(200_000)
    for k in (10, 50):
        assert irradiance(photons, flat(x, y), lookup(k, 0.2))[:, 0].mean() == pytest.approx(1.0, abs=0.015)
    # the mean of 1/A is 0.8 % high at 49 photons (Jensen's inequality; measured in the specification of the estimator)
    assert irradiance(photons, flat(x, y), lookup(50, 0.2, "corrected"))[:, 0].mean() == pytest.approx(1.008, abs=0.01)


def test_h12_a_photon_leaves_itself_out() -> None:
    photons = on_plane(RNG.random((100_000, 2)), distance=0.01 / 0.3)
    p = photons.photons
    inner = np.flatnonzero((np.abs(p.position[:, :2] - 0.5) < 0.4).all(axis=1))[::20]
    n = np.pi * 0.01**2 * 100_000  # 31 photons in the mean

    def mean(own: np.ndarray) -> float:
        where = Points(p.position[inner].astype(float), p.normal[inner].astype(float), np.full(len(inner), 0.02))
        zones = zones_of(photons, where, own, Recipe(0.3, 1e-3, 1.0, 50, 8, DISC, 0, 500, 8, 24))
        return float(zones.irradiance[:, 0].mean())

    assert mean(np.full(len(inner), -1)) == pytest.approx(1 + 1 / n, abs=0.01)
    assert mean(inner) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("share", [0.2, 0.4])
def test_a22_h11_on_a_sphere_the_disc_is_exact_and_the_hull_bright_by_its_formula(share: float) -> None:
    count = 300_000
    n = RNG.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    photons = made(n, n)
    some = n[:300]
    # normals within 0.95 of each other lie within 18.2°, chord 0.316: the filter is what cuts the zone at 0.4
    radius = min(share, 0.31)
    where = Points(some, some, np.full(300, 0.25))
    disc, corrected = (
        irradiance(photons, where, lookup(0, radius, area))[:, 0].mean() * 4 * np.pi for area in ("disc", "corrected")
    )
    assert disc == pytest.approx(1.0, abs=0.01)
    assert corrected == pytest.approx(1 / (1 - radius**2 / 4), abs=0.01)


def test_same_bytes_at_any_thread_count_and_in_parts() -> None:
    world = renderers.load_scene("cornell-box").world()
    whole = trace(world, 70_000, seed=9)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        single = trace(world, 70_000, seed=9)
        alone = photon_map(single)
    finally:
        numba.set_num_threads(threads)
    for a, b in zip(whole.photons, single.photons, strict=True):
        assert a.tobytes() == b.tobytes()
    assert alone.order.tobytes() == photon_map(whole).order.tobytes()
    other = trace(world, 70_000, seed=10)
    assert other.photons.position.tobytes() != whole.photons.position.tobytes()


def test_memory_bound_ends_tracing_and_says_so() -> None:
    world = room(Lambert("white", albedo=(0.98,) * 3))
    traced = trace(world, 10_000_000, seed=1, most_stored=100_000)
    assert traced.full
    assert 100_000 <= len(traced.photons) < 20_000_000
    assert traced.emitted < 10_000_000
    assert "full" in photon_map(traced).notes[0]
    # what was traced is a fair sample: flux per emitted photon
    assert total(traced.photons) == pytest.approx(0.98 / 0.02 * traced.flux, rel=0.02)


def test_saved_map_comes_back_in_scene_units(tmp_path) -> None:  # type: ignore[no-untyped-def]
    import pandas as pd

    world = renderers.load_scene("cornell-box").world()
    traced = trace(world, 2000, seed=1)
    photon_map(traced).save(tmp_path / "photons.parquet", world)
    table = pd.read_parquet(tmp_path / "photons.parquet")
    assert len(table) == len(traced.photons)
    metres = traced.photons.position / world.scale + world.centre
    assert np.abs(table[["position_x", "position_y", "position_z"]].to_numpy() - metres).max() < 1e-5
    assert table["flux_x"].sum() * world.scale**2 == pytest.approx(total(traced.photons)[0], rel=1e-4)


def test_photons_saved_as_exr_are_those_saved_as_parquet(tmp_path) -> None:  # type: ignore[no-untyped-def]
    import pandas as pd

    world = renderers.load_scene("cornell-box").world()
    photons = photon_map(trace(world, 2000, seed=1))
    photons.save(tmp_path / "photons.parquet", world)
    photons.save(tmp_path / "photons.exr", world)
    table, (layers, about) = pd.read_parquet(tmp_path / "photons.parquet"), read_exr(tmp_path / "photons.exr")
    assert (int(about["stored"]), int(about["emitted"])) == (len(table), 2000)
    for name in ("position", "direction", "flux", "normal"):
        flat = layers[name].reshape(-1, 3)
        assert (flat[: len(table)] == table[[f"{name}_{c}" for c in "xyz"]].to_numpy()).all()
        assert not flat[len(table) :].any()
    for name in ("distance", "bounce", "triangle"):
        assert (layers[name].ravel()[: len(table)] == table[name].to_numpy()).all()
    with pytest.raises(ValueError, match=r"\.parquet or \.exr"):
        photons.save(tmp_path / "photons.csv", world)


def test_pictures_show_photons_and_records_where_they_lie() -> None:
    """Points put on the surfaces that pixels see are found at those pixels; turned away, behind the eye or hidden, nowhere."""
    world = renderers.load_scene("cornell-box").world()
    gbuffer = cast_gbuffer(world, (24, 18))
    rows = np.flatnonzero(gbuffer.covered)
    position, normal = gbuffer.position.reshape(-1, 3)[rows], gbuffer.normal.reshape(-1, 3)[rows]
    assert (pixels_of(world, gbuffer, position, normal) == rows).all()
    assert (pixels_of(world, gbuffer, position, -normal) == -1).all()
    assert (pixels_of(world, gbuffer, gbuffer.eye + 2 * (gbuffer.eye - position), -normal) == -1).all()
    assert (pixels_of(world, gbuffer, gbuffer.eye + 1.1 * (position - gbuffer.eye), normal) == -1).all()
    radius = np.linspace(0.1, 1.0, 2)
    image = record_picture(world, gbuffer, position[[0, -1]], normal[[0, -1]], radius).reshape(-1, 3)
    assert image[rows[0]].tolist() == [0, 0, 1]
    assert image[rows[-1]].tolist() == [1, 0, 0]
    photons = photon_map(trace(world, 5000, seed=1)).photons
    picture = photon_picture(world, gbuffer, photons)
    lit = np.unique(pixels_of(world, gbuffer, photons.position, photons.normal))
    assert (np.flatnonzero(picture.max(axis=2)) == lit[lit >= 0]).all()
    assert picture.max() == 1


@pytest.mark.mitsuba
@pytest.mark.parametrize("name", ["photon-map", "photon-map-final-gather"])
def test_images_have_the_energy_of_path_tracing(name: str) -> None:
    scene = renderers.load_scene("cornell-box")
    size = (41, 31)  # no pixel centre on an edge of the room, where rays and look-ups are half outside
    reference = renderers.get_method("pt").render(scene, renderers.get_method("pt").Settings(spp=1024), size=size)
    method = renderers.get_method(name)
    image = method.render(scene, method.Settings(photons=1_000_000, area="corrected"), size=size, seed=1)
    assert image.layers["beauty"].mean() == pytest.approx(reference.layers["beauty"].mean(), rel=0.01)
