"""Dynamic point resampling where it is hard; H numbers are those of the specification."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from soups import apart, ellipsoid, equal_triangles, mixed, soup
from toy_box import toy_box

import renderers
from renderers.methods.flc import FlcSettings, ForwardLightCuts, spheres_of
from renderers.methods.ir import InstantRadiosity, IrSettings
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Channel, Lambert, PointLight, Scene
from renderers.scene.shapes import sphere
from renderers.scene.world import World
from renderers.transport.cuts import DiscreteLevels, geometric_levels
from renderers.transport.interleave import sub_images
from renderers.transport.primary import cast_gbuffer
from renderers.transport.resampling.numbers import keys, mix, number
from renderers.transport.resampling.pattern import pattern
from renderers.transport.resampling.points import Points, resample
from renderers.transport.splat import light_rows, splat
from renderers.transport.vpl import Vpls, emit_resampled

METHOD, IR = ForwardLightCuts(), InstantRadiosity()
LEVELS = DiscreteLevels(*geometric_levels(3, 1.0, 2.0, 2.0))
SMALL = (24, 18)
BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.gl)]


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """`auto` shall not ask for a GL context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe (LLVM 15.0.6, 256 bits)")


def points_on(backend: str, world: World, area: float, seed: int = 0, patches: int | None = None) -> Points:
    """Sorted points of either twin."""
    if backend == "cpu":
        return resample(world, area, seed, patches=patches).sorted()
    from renderers.gl.resample import resample as resample_gl

    return Points(*resample_gl(world, area, keys(seed), patches=patches)).sorted()


def same_points(a: Points, b: Points) -> None:
    np.testing.assert_array_equal(a.triangle, b.triangle)
    np.testing.assert_array_equal(a.numbers, b.numbers)
    for name in ("u", "v", "chance", "weight"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def four_errors(values: list[float] | np.ndarray, expected: float) -> None:
    """The mean lies within four standard errors of what is expected."""
    v = np.asarray(values, np.float64)
    assert abs(v.mean() - expected) < 4 * v.std(ddof=1) / np.sqrt(len(v))


@pytest.mark.parametrize("backend", BACKENDS)
def test_h_1_degenerate_triangles_emit_nothing(backend: str) -> None:
    """10,000 of no area, of no numbers and of infinite ones beside a box with a ball: the same points, to the bit."""
    world = mixed(32)
    eta = float(world.areas.sum()) / 3000
    bad = np.array([[np.nan, 0, 0], [0, np.nan, 1], [np.inf, 0, 0], [1e30, 0, 0], [0, 1e30, 0]], np.float32)
    first, rng = len(world.positions), np.random.default_rng(1)
    lines = rng.integers(first, size=(9_980, 2))
    broken = np.concatenate([
        np.stack([lines[:, 0], lines[:, 1], lines[:, 1]], axis=1),
        np.tile([[first, 0, 1], [first + 1, 2, 3], [first + 2, 5, 6], [first + 3, first + 4, 1]], (5, 1)),
    ])  # fmt: skip
    more = soup(np.concatenate([world.positions, bad]), np.concatenate([world.triangles, broken]))
    same_points(points_on(backend, world, eta), points_on(backend, more, eta))


@pytest.mark.parametrize("backend", BACKENDS)
def test_h_1_needles_stand_for_their_area(backend: str) -> None:
    """Triangles 1 wide and 1e-6 high: as many points as their area says, all of them finite."""
    needles = apart(np.tile([[[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]]], (100_000, 1, 1)))
    found = [points_on(backend, needles, 1e-4, seed) for seed in range(12)]
    assert all(np.isfinite([p.u, p.v, p.chance, p.weight]).all() for p in found)
    four_errors([len(p) for p in found], 100_000 * 0.5e-6 / 1e-4)


@pytest.mark.parametrize("backend", BACKENDS)
def test_h_2_a_triangle_of_exactly_one_point(backend: str) -> None:
    """Legs 1 and 2: area 1 in float32 too. Each is kept, as it is."""
    world = apart(np.tile([[[0, 0, 0], [2, 0, 0], [0, 1, 0]]], (1000, 1, 1)))
    points = points_on(backend, world, 1.0)
    np.testing.assert_array_equal(points.triangle, np.arange(1000))
    assert (points.chance == 1).all()
    assert (points.weight == 1).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ratio", [1e4, 1e5])
def test_h_3_triangles_beyond_the_largest_level(backend: str, ratio: float) -> None:
    """Cut into four until the tessellator manages: 10,000 and 100,000 points from one triangle, each of weight 1."""
    world = equal_triangles(1, ratio)
    found = [points_on(backend, world, 1.0, seed) for seed in range(10)]
    assert all((p.weight == 1).all() for p in found)
    four_errors([len(p) for p in found], ratio)


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_giant_triangle_beside_a_million_tiny_ones(backend: str) -> None:
    """Half the surface each, 20,000 points: half of them on either, evenly over the giant's four quarters."""
    tiny = np.tile([[[0, 0, 0], [1e-3, 0, 0], [0, 2e-3, 0]]], (1_000_000, 1, 1))
    world = apart(np.concatenate([[[[0, 0, 0], [1, 0, 0], [0, 2, 0]]], tiny]))
    points = points_on(backend, world, 1e-4)
    giant = points.triangle == 0
    # Σ u (1 - u) of the tiny ones is 10,000 · (1 - 0.01); of the giant's parts less
    assert abs(int((~giant).sum()) - 10_000) < 4 * np.sqrt(10_000)
    assert abs(int(giant.sum()) - 10_000) < 4 * np.sqrt(10_000)
    u, v = points.u[giant], points.v[giant]
    quarter = np.select([u > 0.5, v > 0.5, u + v < 0.5], [1, 2, 0], 3)
    assert (np.abs(np.bincount(quarter, minlength=4) - 2500) < 4 * np.sqrt(2500)).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_h_4_no_room_for_large_triangles(backend: str) -> None:
    """Room for 3 patches and 12 walls: the others become single points of large weight. No bias, and none is lost."""
    world = mixed(32)
    eta = float(world.areas.sum()) / 3000
    found = [points_on(backend, world, eta, seed, patches=3) for seed in range(200)]
    walls = {int(t) for p in found for t in p.triangle[p.weight > 1]}
    assert walls
    assert walls <= set(range(len(world.triangles) - 12, len(world.triangles)))
    four_errors([float(p.weight.sum(dtype=np.float64)) for p in found], 3000)


def test_h_5_even_levels_keep_every_level_of_the_draw() -> None:
    """Ratio 13, where the printed rule loses 11 % of the sparsest level: each level has its share."""
    world = equal_triangles(400)
    found = [resample(world, 1 / 13, seed) for seed in range(60)]
    counts = np.array([np.bincount(LEVELS.draw(p.level_number).astype(int), minlength=4)[1:] for p in found], float)
    for k in range(3):
        four_errors(counts[:, k], 400 * 13 * LEVELS.shares[k])


@pytest.mark.parametrize("backend", BACKENDS)
def test_h_6_probabilities_below_2_to_the_minus_17(backend: str) -> None:
    """A million triangles kept with 1e-6 each, 20 seeds: 20 points. 16 bits would give none, or 305."""
    world = equal_triangles(1_000_000)
    total = sum(len(points_on(backend, world, 1e6, seed)) for seed in range(20))
    assert abs(total - 20) < 4 * np.sqrt(20)


def rank(values: np.ndarray) -> int:
    """Rank over GF(2) of 32-bit numbers."""
    basis: list[int] = []
    for value in values.tolist():
        for b in basis:
            value = min(value, value ^ b)
        if value:
            basis.append(value)
    return len(basis)


def test_h_7_numbers_of_vertices_have_full_rank() -> None:
    """Any 64 successive vertices, any key; and the bijection that makes them never gives one twice."""
    for seed in range(20):
        for key in keys(seed):
            assert rank(number.py_func(np.arange(64, dtype=np.uint64) + np.uint64(977 * seed), key)) == 32
    assert len(np.unique(mix.py_func(np.arange(1 << 20, dtype=np.uint64)))) == 1 << 20


def test_h_8_places_on_a_huge_triangle_differ() -> None:
    points = resample(equal_triangles(1, 1e5), 1.0)
    assert len(np.unique(np.stack([points.u, points.v]), axis=1).T) > 0.99 * len(points)


def test_h_9_the_area_is_that_of_the_frame() -> None:
    """Stretched threefold along one axis: as many points as the stretched surface asks for."""
    world = ellipsoid(64, 32)
    stretched = soup(world.positions * np.float32([1, 3, 1]), world.triangles)
    eta = float(world.areas.sum()) / 2000
    assert stretched.areas.sum() > 1.5 * world.areas.sum()
    four_errors([len(resample(stretched, eta, seed)) for seed in range(100)], float(stretched.areas.sum()) / eta)


def test_h_10_winding_and_mirrors_do_not_count() -> None:
    """The same triangles are kept with the same numbers; their places may change corners."""
    world = mixed(32)
    eta = float(world.areas.sum()) / 3000
    plain = resample(world, eta)
    for other in (soup(world.positions, world.triangles[:, ::-1]), soup(world.positions * np.float32([-1, 1, 1]), world.triangles)):
        turned = resample(other, eta)
        small = ~np.isin(plain.triangle, np.arange(len(world.triangles) - 12, len(world.triangles)))
        kept = ~np.isin(turned.triangle, np.arange(len(world.triangles) - 12, len(world.triangles)))
        np.testing.assert_array_equal(plain.triangle[small], turned.triangle[kept])
        np.testing.assert_array_equal(plain.numbers[small], turned.numbers[kept])
        assert abs(len(plain) - len(turned)) < 4 * np.sqrt(2 * 3000)


def test_h_11_instances_have_points_of_their_own() -> None:
    """Two copies of one mesh: whether a triangle is kept, less its chance, is uncorrelated: their vertices are numbered apart."""
    b = SceneBuilder("copies")
    mesh = b.shape(sphere(0.5, 64, 32), b.material(Lambert()))
    for x in (-1.0, 1.0):
        b.node(meshes=(mesh,), translation=(x, 0.0, 0.0))
    b.camera((0, 0, 4), (0, 0, 0), 0.8)
    world = b.build().world()
    half = len(world.triangles) // 2
    eta = float(world.areas.max()) * 2
    points = resample(world, eta)
    chance = world.areas[:half] / eta
    first, second = (np.isin(np.arange(half) + start, points.triangle) for start in (0, half))
    assert first.mean() > 0.1
    assert abs(np.corrcoef(first - chance, second - chance)[0, 1]) < 4 / np.sqrt(half)


def lit_by(positions: np.ndarray, normals: np.ndarray, marks: np.ndarray, eps_b: float = 1e-4) -> np.ndarray:
    """Largest light of single white lights of given levels on the toy box, (L,); K = 3, R_1 = 0.1."""
    world = toy_box().world()
    g, family = cast_gbuffer(world, SMALL), DiscreteLevels(*geometric_levels(3, 0.01, 2.0, 2.0))
    white = np.ones_like(positions, np.float32)
    vpls = Vpls(positions.astype(np.float32), normals.astype(np.float32), white, np.arange(len(marks)), len(marks))
    rows = light_rows(vpls, family, marks)
    images = [splat(g, world, np.ascontiguousarray(rows[:, [i]]), family, eps_b) for i in range(len(marks))]
    assert np.isfinite(images).all()
    return np.array([image.max() * family.shares[int(k) - 1] for image, k in zip(images, marks, strict=True)])


def test_h_12_a_light_on_a_receiver() -> None:
    """1e-7 … 1e-3 before a pixel, facing it: at most I ρ/π / ε_b, and only the first level acts there."""
    g = cast_gbuffer(toy_box().world(), SMALL)
    place, normal = g.position[9, 12].astype(np.float64), g.normal[9, 12].astype(np.float64)
    distances = np.geomspace(1e-7, 1e-3, 9)
    for level in (1.0, 2.0, 3.0):
        light = lit_by(place + distances[:, None] * normal, np.tile(-normal, (9, 1)), np.full(9, level))
        assert (light <= 0.7 / np.pi / 1e-4 * 1.001).all()
        if level == 1:
            assert light.max() > 0.5 * 0.7 / np.pi / 1e-4
    # no other pixel is near: the last level's light there is what reaches the walls around
    alone = DiscreteLevels(*geometric_levels(3, 0.01, 2.0, 2.0)).weight(np.array([1.0, 2.0, 3.0]), np.array([1e-6]))
    np.testing.assert_array_equal(alone, [1, 0, 0])


def test_h_13_a_receiver_in_the_tangent_plane_of_a_light() -> None:
    """cos θ_y from 1e-1 down to 0: levels below the last go out, the last one fades without a NaN."""
    g = cast_gbuffer(toy_box().world(), (1, 1))
    place, normal = g.position[0, 0].astype(np.float64), g.normal[0, 0].astype(np.float64)
    across = np.cross(normal, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across)
    cosines = np.array([1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 0.0])
    normals = -cosines[:, None] * normal + np.sqrt(1 - cosines[:, None] ** 2) * across
    family = DiscreteLevels(*geometric_levels(3, 0.01, 2.0, 2.0))
    world = toy_box().world()
    for level in (1.0, 3.0):
        lights = np.tile(place + 0.3 * normal, (6, 1)).astype(np.float32)
        vpls = Vpls(lights, normals.astype(np.float32), np.ones_like(lights), np.arange(6), 6)
        rows = light_rows(vpls, family, np.full(6, level))
        light = np.array([splat(g, world, np.ascontiguousarray(rows[:, [i]]), family, 1e-4).max() for i in range(6)])
        assert np.isfinite(light).all()
        assert (np.diff(light) <= 0).all()
        assert light[-1] < 1e-5 * 0.7 / np.pi / 0.09
        if level == 1:
            assert (light == 0).all()


@pytest.mark.gl
def test_h_14_spheres_at_the_eye() -> None:
    """Around the camera, touching its plane from either side, behind it: the quads give the image of full screens."""
    from renderers.gl.cuts import splat_cuts

    world = toy_box().world()
    g = cast_gbuffer(world, (48, 36))
    eye, forward = world.camera.pose[:3, 3], -world.camera.pose[:3, 2]
    family = DiscreteLevels(*geometric_levels(2, 0.09, 2.0, 2.0))
    steps = np.array([-1.0, -0.6204, -0.3, -1e-7, 0.0, 1e-7, 0.3, 0.6204, 1.0]) * 0.3 * 2**0.5
    lights = (eye + steps[:, None] * forward).astype(np.float32)
    normals = np.tile(forward, (9, 1)).astype(np.float32)
    rows = light_rows(Vpls(lights, normals, np.ones_like(lights), np.arange(9), 9), family, np.ones(9))
    centres, radii = spheres_of(rows)
    bounded, _, touched = splat_cuts(g, world, rows, (centres, radii), family.kernel, 1e-4)
    everywhere, _, all_touched = splat_cuts(g, world, rows, (0 * centres, 0 * radii + 4), family.kernel, 1e-4)
    assert touched == all_touched > 0
    np.testing.assert_array_equal(bounded, everywhere)


def test_h_15_the_last_level_reaches_every_pixel_and_is_counted() -> None:
    """Its lights cost a pair at each pixel; `calibrate` ends the levels before it gets fewer than 32, and a note tells K."""
    frame = METHOD.render(toy_box(), FlcSettings(vpls=2000, sampler="resampled", family="c0", reach=0.1), size=SMALL)
    last = max(int(name.rsplit("_", 1)[1]) for name in frame.counters if name.startswith("vpls_level_"))
    assert frame.counters[f"vpls_level_{last}"] > 10
    assert any(f"K = {last}" in note for note in frame.notes)


@pytest.mark.gl
def test_h_16_small_light_on_top_of_much() -> None:
    """1 + 10,000 × 1e-4 is 2 on the GPU; in half floats it stays 1."""
    from renderers.gl.splat import splat as splat_gl

    world = toy_box().world()
    g = cast_gbuffer(world, (4, 3))
    amount = np.concatenate([[1.0], np.full(10_000, 1e-4)])[:, None]
    snippet = """
        struct Item { float amount; };
        Item item_at(int index) { return Item(payload(index, 0).x); }
        bool misses(Node node, int index) { return false; }
        vec4 contribution(Receiver receiver, Item item) { return vec4(item.amount); }
    """
    image, _ = splat_gl(g, world, np.zeros((10_001, 3)), np.full(10_001, 4.0), amount, snippet)
    # 10,000 roundings of at most 2⁻²⁴ · 2 each
    np.testing.assert_allclose(image[g.covered], 2, atol=10_000 * 2.0**-23)
    assert np.float16(1) + np.float16(1e-4) == np.float16(1)


@pytest.mark.parametrize("backend", BACKENDS)
def test_h_17_an_area_a_rounding_above_one_point(backend: str) -> None:
    """Ratio 1 + 1.2e-7: cut into six parts of a sixth each, none lost."""
    world = equal_triangles(2000, 1.0000002)
    found = [points_on(backend, world, 1.0, seed) for seed in range(20)]
    four_errors([len(p) for p in found], 2000)
    assert all((p.level_number < 1).all() for p in found)


def test_h_18_sub_images_hold_each_pixel_once_or_refuse() -> None:
    """Sizes that don't divide are refused by name instead of padded."""
    g = cast_gbuffer(toy_box().world(), SMALL)
    seen = np.zeros(g.triangle.shape, int)
    for place, _ in sub_images(g, 2):
        seen[place] += 1
    assert (seen == 1).all()
    with pytest.raises(ValueError, match="width and height divisible by 4"):
        METHOD.render(toy_box(), FlcSettings(vpls=64, sampler="resampled", interleave=4), size=(25, 18))


def test_h_19_lattice_points_of_the_finest_level_have_numbers_of_their_own() -> None:
    """A hash stands where the thesis has a texture of random numbers, whose size decides; here there is none."""
    points = np.unique(pattern(64).reshape(-1, 2), axis=0).astype(np.uint64)
    codes = (points[:, 0] << np.uint64(16)) | points[:, 1]
    for key in keys(3):
        assert len(np.unique(number.py_func(codes, key))) == len(points)


def test_h_20_the_clamp_darkens_monotonically() -> None:
    """The same points, ε_b from 3 m² down: the mean grows at each step towards the unclamped one."""

    def mean(eps_b: float) -> float:
        settings = IrSettings(vpls=4000, sampler="resampled", eps_b=eps_b)
        return float(IR.render(toy_box(), settings, size=SMALL).layers["indirect"].mean(dtype=np.float64))

    means = [mean(eps_b) for eps_b in (3.0, 1.0, 0.3, 0.1, 0.01, 0.0)]
    assert (np.diff(means) >= 0).all()
    assert means[0] < 0.9 * means[-1]
    assert means[4] > 0.95 * means[-1]


def checkered() -> Scene:
    """The toy box with a light that is near one wall, and cells of albedo 0.05 and 0.95 in turn."""
    b = SceneBuilder("checkered box")
    paints = [b.material(Lambert(albedo=(a, a, a))) for a in (0.05, 0.95)]
    walls = toy_box(8)
    for mesh in walls.meshes[1:]:
        odd = np.arange(len(mesh.triangles)) % 2 == 1
        for paint, faces in zip(paints, (mesh.triangles[odd], mesh.triangles[~odd]), strict=True):
            b.place((mesh.positions, mesh.normals, faces), paint)
    b.light(PointLight("lamp", intensity=1.0), (-0.3, 0.9, 0.3))
    b.camera((0.0, 0.1, 0.95), (0.0, -0.1, 0.0), np.radians(70))
    return b.build()


def test_h_21_strong_contrasts_average_out() -> None:
    """Neighbours of albedo 0.05 and 0.95: 64 passes have less than a fourth of the error of one."""
    scene = checkered()
    truth = IR.render(scene, IrSettings(vpls=1 << 16, sampler="low-discrepancy", eps_b=0.01, light_samples=1), size=SMALL).layers[
        "indirect"
    ]

    def error(passes: int, seed: int) -> float:
        settings = FlcSettings(vpls=2000, sampler="resampled", passes=passes, eps_b=0.01)
        image = METHOD.render(scene, settings, size=SMALL, seed=seed).layers["indirect"]
        return float(np.mean((image - truth) ** 2))

    single, many = (np.sqrt(np.mean([error(passes, seed) for seed in range(4)])) for passes in (1, 64))
    assert many < single / 4


def test_h_22_one_diffuse_bounce_is_what_it_says() -> None:
    """More bounces and glossy sources are out of scope: the Transport and the claims say so, and a glossy scene stays finite."""
    settings = FlcSettings(vpls=500, sampler="resampled")
    assert METHOD.transport(settings) == "one-bounce-unoccluded"
    assert METHOD.claims["glossy"].support == "approximated"
    frame = METHOD.render(renderers.load_scene("cornell-glossy"), settings, size=SMALL)
    assert np.isfinite(frame.layers["beauty"]).all()


def vpls_of(world: World, seed: int = 5) -> Vpls:
    area = 27 * world.scale**2 / 4000
    return emit_resampled(world, resample(world, area, seed), area, 1, seed, Counter())


def test_a_moving_camera_leaves_the_lights_alone() -> None:
    """New Worlds of the same geometry: not one light changes, to the bit."""
    still = toy_box()
    camera = next(i for i, node in enumerate(still.nodes) if node.camera is not None)
    start = np.array(still.nodes[camera].translation)
    path = Channel("node", camera, "translation", np.array([0.0, 1.0]), np.stack([start, start - [0, 0, 0.5]]))
    scene = replace(still, channels=(path,))
    first, later = scene.world(0), scene.world(12)
    assert not np.array_equal(first.camera.pose, later.camera.pose)
    for a, b in zip(vars(vpls_of(first)).values(), vars(vpls_of(later)).values(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_moving_ball_changes_the_points_on_it_alone() -> None:
    """Rigid motion keeps those too: points stay at their places on their triangles; walls' lights change in its shadow only."""
    still = toy_box()
    start = np.array(still.nodes[0].translation)
    scene = replace(
        still, channels=(Channel("node", 0, "translation", np.array([0.0, 1.0]), np.stack([start, start + np.array([0.1, 0, 0])])),)
    )
    first, later = scene.world(0), scene.world(3)
    area = 27 * first.scale**2 / 4000
    before, after = resample(first, area, 5), resample(later, area, 5)
    ball = len(still.meshes[0].triangles)
    walls = before.triangle >= ball
    np.testing.assert_array_equal(before.triangle[walls], after.triangle[after.triangle >= ball])
    np.testing.assert_array_equal(before.u[walls], after.u[after.triangle >= ball])
    assert len(np.setxor1d(before.triangle[~walls], after.triangle[after.triangle < ball])) <= 1e-4 * ball
    lights = [emit_resampled(w, p, area, 1, 5) for w, p in ((first, before), (later, after))]
    shared, a, b = np.intersect1d(*(light.index[light.index >= (~walls).sum()] for light in lights), return_indices=True)
    strength = [light.intensities[light.index >= (~walls).sum()][i] for light, i in zip(lights, (a, b), strict=True)]
    assert len(shared) > 0.9 * walls.sum()
    assert (strength[0] == strength[1]).all(axis=1).mean() > 0.9


def swelling() -> Scene:
    """The toy box, whose ball grows by 1 % a frame."""
    still = toy_box()
    keys = np.array([0.0, 1.0]), np.array([[1.0, 1.0, 1.0], [1.24, 1.24, 1.24]])
    return replace(still, channels=(Channel("node", 0, "scale", *keys),))


def test_light_flickers_less_than_with_points_drawn_by_area() -> None:
    """A growing ball moves the limits by which uniform points are drawn, and with them the points on all walls; these stay.

    Change of the indirect light from frame to frame, over its mean: less than half, at 2000 points and the same seed.
    """

    def change(sampler: str) -> float:
        settings = IrSettings(vpls=2000, sampler=sampler, eps_b=0.01, eta=27 / 2000)  # type: ignore[arg-type]
        images = [IR.render(swelling(), settings, size=SMALL, seed=3, frame=k).layers["indirect"][..., 1] for k in range(6)]
        return float(np.sqrt(np.mean(np.diff(images, axis=0) ** 2)) / np.mean(images))

    assert change("resampled") < change("uniform") / 2
