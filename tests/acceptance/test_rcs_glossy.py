"""Radiance records against the specification's checks (R…) and hard cases (H…): coefficients, turns, splats, traced lobes."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import POINTS_1, Constant, Radiance1, room_1, room_2, sites
from numpy.typing import NDArray

import renderers
from renderers.methods.rcs import RadianceCacheSplatting, RcsSettings
from renderers.scene.model import GGX, Lambert, Material, Phong, Scene
from renderers.scene.world import GGX_KIND, PHONG, World
from renderers.transport.brdf import evaluate, materials_at
from renderers.transport.caching.glossy import reflected
from renderers.transport.caching.hemisphere import Grid, PolarSampler
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.radiance import RadianceSampler
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.reflectance import Lobes, Shape, gloss_of, order_of_shape
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.traced import traced_lobes
from renderers.transport.direct import receivers_of
from renderers.transport.hemispherical.brdf_table import brdf_coefficients, brdf_table
from renderers.transport.hemispherical.models import phong, ward
from renderers.transport.hemispherical.rotation import rotate
from renderers.transport.primary import cast_gbuffer
from renderers.transport.sampling import frame

F64 = NDArray[np.float64]
METHOD = RadianceCacheSplatting()
pytestmark = pytest.mark.usefixtures("software_device")  # the CPU path


@pytest.fixture(scope="module")
def first() -> World:
    return room_1().world()


def with_walls(material: Material, scene: Scene | None = None) -> Scene:
    """Room 2 with all its surfaces, or only what is lambertian of another scene, of one material."""
    scene = room_2() if scene is None else scene
    return replace(scene, materials=tuple(replace(material, name=m.name) for m in scene.materials))


def relative(values: F64, expected: F64) -> float:
    return float(np.linalg.norm(values - expected) / np.linalg.norm(expected))


def test_r6_constant_radiance_has_one_coefficient_and_no_gradient(first: World) -> None:
    here = sites(first, POINTS_1[:, 0], POINTS_1[:, 1])
    records = RadianceSampler(first, Grid(8, 25), Constant(1.0), 10)(here)
    assert records.coefficients is not None
    assert records.coefficient_gradients is not None
    expected = np.zeros((8, 100, 3))
    expected[:, 0] = np.sqrt(2 * np.pi)
    # rays between the edges of the room's walls miss; where all hit, integrals of harmonics over the hemisphere to rounding
    np.testing.assert_allclose(records.coefficients, expected, atol=1e-6)
    np.testing.assert_allclose(records.irradiance, np.pi, rtol=1e-9)
    assert np.abs(records.coefficient_gradients).max() < 1e-12
    assert np.abs(records.rotation).max() < 1e-6


@pytest.mark.parametrize("point", [0, 3])
def test_r12_gradients_of_the_coefficients(first: World, point: int) -> None:
    """Order 5, 64×200 cells, against differences over ±4 cm of 500×1600 cells: all coefficients together within 0.12."""
    place, normal = POINTS_1[point, 0], POINTS_1[point, 1]
    found = RadianceSampler(first, Grid(64, 200), Radiance1(first), 5, jitter=False)(sites(first, place, normal))
    fine = RadianceSampler(first, Grid(500, 1600), Radiance1(first), 5, jitter=False)
    axes = np.stack(frame(normal[None]), axis=1)[0]
    moved = [[fine(sites(first, place + s * 0.04 * axis, normal)).coefficients for s in (1, -1)] for axis in axes]
    expected = np.stack([(ahead - behind)[0, :, 0] / 0.08 for ahead, behind in moved])  # type: ignore[operator]
    assert found.coefficient_gradients is not None
    assert relative(found.coefficient_gradients[0, :, :, 0] * first.scale, expected) <= 0.12


def test_r13_irradiance_and_its_gradients_from_the_coefficients(first: World) -> None:
    here = sites(first, POINTS_1[:6, 0], POINTS_1[:6, 1])
    records = RadianceSampler(first, Grid(64, 200), Radiance1(first), 5, jitter=False)(here)
    # 64 rings of equal solid angle: 0.25 % of E from the cells at light's edges
    np.testing.assert_allclose(records.irradiance[:, 0], POINTS_1[:6, 2, 0], rtol=2.5e-3)
    slope = records.translation[:, 0] * first.scale
    errors = np.linalg.norm(slope - POINTS_1[:6, 3], axis=1) / np.linalg.norm(POINTS_1[:6, 3], axis=1)
    assert np.median(errors) <= 0.06
    assert errors.max() <= 0.10
    turn = np.linalg.norm(records.rotation[:, 0] - POINTS_1[:6, 4], axis=1) / np.linalg.norm(POINTS_1[:6, 4], axis=1)
    assert turn.max() <= 0.05


def test_r14_harmonic_mean_distance_is_that_of_irradiance_records(first: World) -> None:
    here = sites(first, POINTS_1[:, 0], POINTS_1[:, 1])
    radii = [
        RadianceSampler(first, Grid(64, 200), Radiance1(first), 2, jitter=False)(here).radius,
        PolarSampler(first, Grid(64, 200), Radiance1(first), jitter=False)(here).radius,
    ]
    np.testing.assert_allclose(radii[0], radii[1], rtol=2e-3)


@pytest.mark.parametrize(
    ("kind", "sharpness", "order"),
    [(PHONG, 5.0, 5), (PHONG, 15.0, 8), (PHONG, 20.0, 9), (PHONG, 50.0, None), (PHONG, 1e5, None), (GGX_KIND, 1.0, 3),
     (GGX_KIND, 0.16, None), (GGX_KIND, 1e-3, None)],
)  # fmt: skip
def test_h19_sharpness_decides_the_order(kind: int, sharpness: float, order: int | None) -> None:
    """Up to order 12; an exponent of 15 needs 8, one of 50 more than there is."""
    assert order_of_shape(Shape(kind, sharpness)) == order


@pytest.mark.parametrize(
    "material",
    [Phong("p", (0.3, 0.2, 0.1), (0.5, 0.4, 0.6), 20.0), GGX("g", (0.7, 0.5, 0.2), 0.3, 0.7), GGX("m", (0.9,) * 3, 1.0, 0.65)],
)
def test_r28_reflected_light_of_records_against_quadrature(material: Material) -> None:
    """The same hemisphere, 128×400 cells: Σ c_i λ_i against the sum over the cells with the BRDF itself, RMS ≤ 0.03 of the mean."""
    world = with_walls(material).world()
    gbuffer = cast_gbuffer(world, (12, 9))
    gloss = gloss_of(world)
    rows = np.flatnonzero(gloss.cached(gbuffer))
    assert len(rows) > 80
    here = Sites(*receivers_of(world, gbuffer, rows))
    sampler = RadianceSampler(world, Grid(128, 400), ReflectedDirectLight(world), gloss.order, jitter=False)
    lobes, found, exact = Lobes(world, gbuffer, rows, gloss), [], []
    m = materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows])
    for p in range(0, len(rows), 9):
        cast, _ = sampler.hemispheres(here.rows([p]))
        record = sampler.summed(here.rows([p]), cast)
        assert record.coefficients is not None
        found.append(np.einsum("ci,ic->c", lobes(slice(p, p + 1))[0], record.coefficients[0]))
        light = cell_directions(128, 400) @ np.concatenate([cast.tangents[0], here.normal[[p]]])
        cells, normal, view = len(light), here.normal[p], gbuffer.eye - here.position[p]
        view /= np.linalg.norm(view)
        f = evaluate(m.rows(np.full(cells, p)), np.tile(normal, (cells, 1)), light, np.tile(view, (cells, 1)))
        exact.append(2 * np.pi / cells * (f * (light @ normal)[:, None] * cast.radiance.reshape(-1, 3)).sum(axis=0))
    error = np.array(found) - exact
    assert np.sqrt(np.mean(error**2)) <= 0.03 * np.mean(exact)


def cell_directions(rings: int, sectors: int) -> F64:
    mu = 1 - (np.arange(rings) + 0.5) / rings
    phi = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    mu, phi = np.repeat(mu, sectors), np.tile(phi, rings)
    r = np.sqrt(1 - mu**2)
    return np.stack([r * np.cos(phi), r * np.sin(phi), mu], axis=1)


def test_an_order_is_refused_where_it_holds_no_lobe() -> None:
    assert order_of_shape(Shape(PHONG, 50.0), 10) is None
    assert order_of_shape(Shape(PHONG, 15.0), 5) is None


def curved(count: int = 300) -> tuple[Canvas, Records, F64]:
    """A bumpy sheet of 40×40 pixels, records of order 4 on it, and coefficients of the pixels' reflectance."""
    rng, side = np.random.default_rng(1), 40
    y, x = np.divmod(np.arange(side * side), side)
    normal = np.stack([0.4 * np.cos(x / 3), 0.3 * np.sin(y / 4), 1 + 0.0 * x], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    position = np.stack([x / side * 2 - 1, y / side * 2 - 1, 0.1 * np.sin(x / 5)], axis=1)
    canvas = Canvas(np.arange(side * side), side, position, normal)
    at = rng.integers(0, side * side, count)
    zeros = np.zeros((count, 3, 3))
    records = Records(
        position[at], normal[at], rng.uniform(0.2, 0.6, count), rng.random((count, 3)), zeros, zeros,
        rng.normal(size=(count, 16, 3)), rng.normal(size=(count, 2, 16, 3)),
    )  # fmt: skip
    return canvas, records, rng.normal(size=(side * side, 3, 16)).astype(np.float32)


def test_r17_radiance_splat_equals_a_gather_with_turns() -> None:
    """Pixel by pixel in float64: extrapolate in the record's frame, turn by `rotation.rotate`, multiply, clamp, weight."""
    canvas, records, brdf = curved()
    counters = Counter[str]()
    found = reflected(canvas, records, lambda part: brdf[part], 0.5, counters=counters)
    assert counters["glossy_turns"] > 0.9 * counters["glossy_splats"] > 1000
    f_k = np.stack([*frame(records.normal), records.normal], axis=1)
    assert records.coefficients is not None
    assert records.coefficient_gradients is not None
    for p in range(0, 1600, 41):
        n, off = canvas.normal[p].astype(np.float64), canvas.position[p] - records.position
        e = np.linalg.norm(off, axis=1) / records.radius + np.linalg.norm(n - records.normal, axis=1) / np.sqrt(2)
        inside = np.flatnonzero(e <= 0.5)
        if not len(inside):
            assert not found[p].any()
            continue
        f_p = np.stack([*frame(n[None]), n[None]], axis=1)[0]
        delta = np.einsum("ktd,kd->kt", f_k[inside, :2], off[inside])
        light = records.coefficients[inside] + np.einsum("kt,ktic->kic", delta, records.coefficient_gradients[inside])
        turned = rotate(light, f_p @ f_k[inside].transpose(0, 2, 1))
        values = np.maximum(0, np.einsum("ci,kic->kc", brdf[p].astype(np.float64), turned))
        weight = 1 / np.maximum(e[inside], 1e-3)
        # float32 sums of 16 products of size 1
        np.testing.assert_allclose(found[p], weight @ values / weight.sum(), rtol=1e-4, atol=1e-5)


def test_h20_without_turns_a_tilt_of_five_degrees_ruins_a_lobe() -> None:
    """Order 10, exponent 20, floor of room 2: a record's own coefficients at a normal 5° off are wrong by over 15 %, turned ones by
    under 3 %."""
    world, tilt = room_2().world(), np.radians(5)
    upright, tilted = np.array([0.0, 0, 1]), np.array([np.sin(tilt), 0, np.cos(tilt)])
    sampler = RadianceSampler(world, Grid(64, 200), ReflectedDirectLight(world), 10, jitter=False)
    places = [(0.1, -0.6, 0), (-1, -0.8, 0), (-1.2, 1.1, 0), (1.3, -0.5, 0)]
    record, exact = (sampler(sites(world, places, np.tile(n, (4, 1)))).coefficients for n in (upright, tilted))
    assert record is not None
    assert exact is not None
    axes = [np.concatenate([np.stack(frame(n[None]))[:, 0], n[None]]) for n in (upright, tilted)]
    turned = rotate(record, axes[1] @ axes[0].T)
    views = np.random.default_rng(3).normal(size=(200, 3)) * [1, 1, 0] + [0, 0, 1.0]
    c = brdf_coefficients(phong(20.0), views / np.linalg.norm(views, axis=1, keepdims=True), 10)[:, :, 0]
    light = [np.einsum("vi,pi->pv", c, of[:, :, 0]) for of in (exact, record, turned)]
    error = [np.sqrt(np.mean((other - light[0]) ** 2)) / light[0].mean() for other in light[1:]]
    assert error[0] > 0.15
    assert error[1] < 0.03


def test_tabulated_brdfs_are_multiplied_as_well() -> None:
    """A table of Ward's anisotropic model in constant light: reflected radiance is its directional albedo, to the table's 1 %."""
    canvas, records, _ = curved(40)
    assert records.coefficients is not None
    flat = np.zeros_like(records.coefficients)
    flat[:, 0] = np.sqrt(2 * np.pi)
    records = replace(
        records, normal=np.tile([0.0, 0, 1], (40, 1)), coefficients=flat, coefficient_gradients=np.zeros((40, 2, 16, 3))
    )
    canvas = Canvas(canvas.rows, 40, canvas.position, np.tile([0.0, 0, 1], (1600, 1)))
    view = np.array([np.sin(0.6), 0, np.cos(0.6)])
    table = brdf_table(ward(0.4, 0.8, 0.5, 0.2), 4, 64)
    coefficients = np.repeat(table.lookup(view[None]).transpose(0, 2, 1), 3, axis=1)
    found = reflected(canvas, records, lambda part: np.repeat(coefficients, part.stop - part.start, axis=0), 0.5)
    light = cell_directions(300, 600)
    albedo = 2 * np.pi * np.mean(ward(0.4, 0.8, 0.5, 0.2)(light, view) * light[:, 2])
    reached = found.any(axis=1)
    assert reached.sum() > 400
    np.testing.assert_allclose(found[reached], albedo, rtol=0.01)


def test_records_are_made_only_where_the_material_is_glossy() -> None:
    """All pixels of the back wall and no others; a scene without gloss has no radiance record at all."""
    world = renderers.load_scene("cornell-glossy").world()
    gbuffer = cast_gbuffer(world, (32, 24))
    gloss = gloss_of(world)
    shiny = gbuffer.covered & (world.materials.kind[gbuffer.material] == PHONG)
    assert shiny.sum() > 50
    np.testing.assert_array_equal(gloss.cached(gbuffer), shiny)
    assert not gloss.traced(gbuffer).any()
    assert not gloss.diffuse(world, gbuffer)[shiny].any()
    frame_ = METHOD.render(room_2(), RcsSettings(rays=64), size=(16, 12))
    assert "radiance_records" not in frame_.counters


def test_diffuse_surfaces_described_as_glossy_give_the_same_image() -> None:
    """A Phong material without specular part is Lambert's; one with a lobe of exponent 0 is nearly as dull."""
    size, settings = (24, 18), RcsSettings(rays=1024, glossy_rays=4096, a=0.1, glossy_a=0.1)
    lambert, dull, lobe = (
        METHOD.render(with_walls(m), settings, size=size)
        for m in (Lambert("x", (0.5,) * 3), Phong("x", (0.5,) * 3, (0.0,) * 3, 9.0), Phong("x", (0.0,) * 3, (0.5,) * 3, 0.0))
    )
    np.testing.assert_array_equal(dull.layers["indirect"], lambert.layers["indirect"])
    assert lobe.counters["radiance_records"] > 0
    # r·v > 0 ends half of such a lobe at an oblique plane: only the size agrees, Σ f cos being between half and all of ρ
    ratio = lobe.layers["indirect"].mean() / lambert.layers["indirect"].mean()
    assert 0.5 < ratio < 1.0


@pytest.mark.parametrize("material", [Phong("p", (0.1,) * 3, (0.6,) * 3, 20.0), GGX("g", (0.8,) * 3, 0.0, 0.7)])
def test_traced_lobes_and_records_agree(material: Material) -> None:
    """What is traced with 4096 rays a pixel against records there: two estimates of one integral, 5 % apart (RMS over the mean)."""
    world = with_walls(material).world()
    gbuffer, gloss = cast_gbuffer(world, (12, 9)), gloss_of(world)
    rows = np.flatnonzero(gloss.cached(gbuffer))[::4]
    incoming = ReflectedDirectLight(world)
    here = Sites(*receivers_of(world, gbuffer, rows))
    records = RadianceSampler(world, Grid(100, 314), incoming, gloss.order)(here)
    assert records.coefficients is not None
    by_records = np.einsum("pci,pic->pc", Lobes(world, gbuffer, rows, gloss)(slice(0, len(rows))), records.coefficients)
    sharp = gloss._replace(shape=np.where(gloss.shape >= 0, -2, gloss.shape))
    albedo = sharp.diffuse(world, gbuffer).reshape(-1, 3)[rows]
    traced = traced_lobes(world, gbuffer, rows, 4096, incoming) + albedo / np.pi * records.irradiance
    assert np.sqrt(np.mean((traced - by_records) ** 2)) <= 0.05 * by_records.mean()


def test_mirror_like_lobes_are_traced_with_a_notice() -> None:
    scene = with_walls(Phong("mirror", (0.2,) * 3, (0.6,) * 3, 2000.0))
    frame_ = METHOD.render(scene, RcsSettings(rays=64, lobe_rays=4), size=(16, 12))
    assert frame_.counters["pixels_traced"] == frame_.counters["pixels_covered"]
    assert "radiance_records" not in frame_.counters
    assert "too sharp" in frame_.notes[0]
    cut = METHOD.render(
        with_walls(Phong("p", (0.2,) * 3, (0.6,) * 3, 60.0)), RcsSettings(rays=64, glossy_rays=64, sharp="truncated"), size=(16, 12)
    )
    assert cut.counters["radiance_records"] > 0
    assert "ring" in cut.notes[0]


def test_same_bytes_at_any_thread_count_with_glossy_records() -> None:
    import numba

    scene, threads, images = renderers.load_scene("cornell-glossy"), numba.get_num_threads(), []
    try:
        for count in (1, threads):
            numba.set_num_threads(count)
            frame_ = METHOD.render(scene, RcsSettings(rays=64, glossy_rays=256), size=(24, 18))
            images.append(frame_.layers["indirect"].tobytes())
    finally:
        numba.set_num_threads(threads)
    assert images[0] == images[1]
