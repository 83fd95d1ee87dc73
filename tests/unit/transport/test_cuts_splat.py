"""The splatting kernels against a plain double loop: every family, any BRDF, with and without occlusion, near and far lights."""

from __future__ import annotations

from collections import Counter

import numba
import numpy as np
import pytest

import renderers
from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.brdf import evaluate
from renderers.transport.cuts import DiscreteLevels, Family, LinearLevels, RidgeLevels, coordinate, geometric_levels
from renderers.transport.gather import gather, pixels_of
from renderers.transport.interleave import joined, sub_images
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import caster_of, segments_blocked
from renderers.transport.roulette import RouletteLevels
from renderers.transport.sampling import generator, uniform_sphere
from renderers.transport.splat import light_rows, splat
from renderers.transport.supports import inverse_root, log_of
from renderers.transport.tiles import AREA, tiles_of
from renderers.transport.vpl import Vpls

AREAS, SHARES = geometric_levels(3, 0.1, 2.0, 3.0)
FAMILIES: dict[str, Family] = {
    "one": DiscreteLevels(np.array([0.1]), np.array([1.0])),
    "c0": DiscreteLevels(AREAS, SHARES),
    "c-1": DiscreteLevels(AREAS, SHARES, smooth=False),
    "linear": LinearLevels(AREAS, np.log(3)),
    "ridge": RidgeLevels(np.log(3), 1 / np.log(3), 0.1),
    "roulette": RouletteLevels(0.05),
}
SIZE = (45, 26)


def lights(count: int) -> Vpls:
    """Lights anywhere: inside and outside the room, before, around and behind the camera."""
    rng = generator(9, "lights")
    positions = rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    normals = uniform_sphere(rng.random((count, 2))).astype(np.float32)
    return Vpls(positions, normals, rng.random((count, 3)).astype(np.float32), np.arange(count), count)


def oracle(g: GBuffer, world: World, vpls: Vpls, family: Family, marks: np.ndarray, eps_b: float, occluded: bool) -> np.ndarray:
    """Algorithm 3, one light at a time, float64; float32 (H, W, 3) and the number of lit pairs."""
    p = pixels_of(g, world)
    position, normal = p.position.astype(np.float64), p.normal.astype(np.float64)
    total = np.zeros((len(p.rows), 3))
    for n in range(len(vpls)):
        y, ny = vpls.positions[n].astype(np.float64), vpls.normals[n].astype(np.float64)
        v = y - position
        r2 = np.einsum("ij,ij->i", v, v)
        light = v / np.sqrt(r2)[:, None]
        cosines = np.maximum(0, np.einsum("ij,ij->i", light, normal)) * np.maximum(0, -(light @ ny))
        weight = family.weight(marks[n], np.minimum(coordinate(position, y, ny), 1e15)) / family.density(marks[n])
        value = weight * cosines / np.maximum(eps_b, r2)
        lit = np.flatnonzero(value > 0)
        if occluded and len(lit):
            ends = np.tile(y, (len(lit), 1)), np.tile(ny, (len(lit), 1))
            value[lit[segments_blocked(caster_of(world), position[lit], p.geometric[lit], *ends)]] = 0
        total += evaluate(p.materials, normal, light, p.view) * value[:, None] * vpls.intensities[n].astype(np.float64)
    out = np.zeros((g.triangle.size, 3))
    out[p.rows] = total
    return out.reshape(*g.triangle.shape, 3)


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(("scene", "occluded"), [("cornell-box", False), ("cornell-glossy", False), ("cornell-box", True)])
def test_ac_32_kernels_match_the_double_loop(name: str, scene: str, occluded: bool) -> None:
    world, family, vpls = renderers.load_scene(scene).world(), FAMILIES[name], lights(120)
    g = cast_gbuffer(world, SIZE)
    marks = family.draw(generator(1, "levels").random(len(vpls)))
    counters = Counter[str]()
    caster = caster_of(world) if occluded else None
    ours = splat(g, world, light_rows(vpls, family, marks), family, 1e-4, caster, counters)
    exact = oracle(g, world, vpls, family, marks, 1e-4, occluded)
    # float32: α carries about 10 roundings, which a hat's flank (as wide as its a) turns into 1e-5 of a term; a step, and a shadow
    # ray that grazes an edge, may go the other way in single pairs.
    wrong = np.abs(ours - exact) > 3e-5 * exact + 1e-6
    assert wrong.mean() <= (0.002 if name == "c-1" or occluded else 0)
    assert ours.mean() == pytest.approx(exact.mean(), rel=1e-3)
    assert 0 < counters["pixels_touched"] <= counters["light_evaluations"]
    assert (counters["rays"] > 0) == occluded


@pytest.mark.parametrize("occluded", [False, True])
def test_ac_23_one_level_is_instant_radiosity(occluded: bool) -> None:
    """Light by light, so without another order of summation. Both kernels may fuse their some ten operations differently (1e-6);
    where n·v is small it has an absolute error of 2e-7 |v|: 1e-6 of what a facing receiver would get. The method itself has the
    bytes of `ir` (test_flc.py)."""
    world, family, vpls = renderers.load_scene("cornell-box").world(), FAMILIES["one"], lights(40)
    g = cast_gbuffer(world, SIZE)
    caster = caster_of(world) if occluded else None
    for n in range(len(vpls)):
        one = Vpls(vpls.positions[n : n + 1], vpls.normals[n : n + 1], vpls.intensities[n : n + 1], np.zeros(1, np.int64), 1)
        ours = splat(g, world, light_rows(one, family, np.ones(1)), family, 1e-4, caster)
        theirs = gather(g, world, one.positions, one.normals, one.intensities, 1e-4, caster)
        np.testing.assert_allclose(ours, theirs, rtol=3e-6, atol=1e-6 * theirs.max())


def test_work_follows_the_supports() -> None:
    """Nearly all pairs evaluated lie in tiles that a support crosses: small supports cost little, whatever the number of lights."""
    world, vpls = renderers.load_scene("empty-room").world(), lights(300)
    g = cast_gbuffer(world, (96, 54))
    work = []
    for reach in (0.05, 0.2, 0.8):
        # two levels, all lights on the first: bounded by √2 · reach
        family = DiscreteLevels(*geometric_levels(2, reach**2, 2.0, 2.0))
        counters = Counter[str]()
        splat(g, world, light_rows(vpls, family, np.ones(len(vpls))), family, 1e-4, None, counters)
        work.append(counters["light_evaluations"] / (300 * g.covered.sum()))
    assert work[0] < 0.02
    assert work[0] < work[1] < work[2] < 0.6


def test_h_2_and_h_3_light_on_and_beside_the_receiver() -> None:
    """Receivers 1e-6 … 1 from a light, above it, and in its tangent plane: finite, at most I/ε_b, 0 at the light itself."""
    world = renderers.load_scene("cornell-box").world()
    r = np.geomspace(1e-6, 1, 25)
    up = np.stack([0 * r, r, 0 * r], axis=1)
    beside = np.stack([r, 1e-7 * r, 0 * r], axis=1)
    points = np.concatenate([np.zeros((1, 3)), up, beside]).astype(np.float32)
    n, zero = len(points), np.zeros((1, len(points)), np.int32)
    ones = np.ones((1, n, 3), np.float32)
    down = np.tile(np.array([0, -1, 0], np.float32), (1, n, 1))
    g = GBuffer(points[None], down, ones, 0 * ones, zero, zero, np.array([0.0, -2, 0]))
    light = Vpls(
        np.zeros((1, 3), np.float32), np.array([[0, 1, 0]], np.float32), np.ones((1, 3), np.float32), np.zeros(1, np.int64), 1
    )
    for name, family in FAMILIES.items():
        mark = np.full(1, 1.0)
        image = splat(g, world, light_rows(light, family, mark), family, 1e-4)[0, :, 0]
        bound = 2 / float(family.density(1.0)) / 1e-4 / np.pi
        assert np.isfinite(image).all(), name
        assert image[0] == 0
        assert image.max() <= bound
        assert (image[26:] <= 1e-6 * bound).all(), name


def test_tiles_hold_every_covered_pixel_once() -> None:
    world = renderers.load_scene("cornell-box").world()
    g = cast_gbuffer(world, SIZE)
    p = pixels_of(g, world)
    tiles = tiles_of(p.rows, SIZE[0], p.position, p.normal)
    inside = tiles.pixel[tiles.pixel >= 0]
    np.testing.assert_array_equal(np.sort(inside), np.arange(len(p.rows)))
    assert tiles.pixel.shape[1] == AREA
    for t, pixel in enumerate(tiles.pixel):
        own = pixel[pixel >= 0]
        bound = tiles.tile_bounds[t].astype(np.float64)
        block = tiles.block_bounds[np.searchsorted(tiles.first, t, side="right") - 1].astype(np.float64)
        for around in (bound, block):
            # 2e-7: rounding of the bound to float32
            assert (np.linalg.norm(p.position[own] - around[:3], axis=1) <= around[3]).all()
            assert (np.linalg.norm(p.normal[own] - around[4:7], axis=1) <= around[7] + 2e-7).all()
            assert (p.position[own].astype(np.float64) @ around[4:7] >= around[8] - 2e-7).all()


def test_functions_of_the_kernels_are_as_exact_as_they_say() -> None:
    x = np.geomspace(1e-18, 1e3, 20000).astype(np.float32)
    roots, logs = _functions(x, np.geomspace(1, 1e20, 20000).astype(np.float32))
    np.testing.assert_allclose(roots, 1 / np.sqrt(x.astype(np.float64)), rtol=3e-7)
    exact = np.log(np.geomspace(1, 1e20, 20000).astype(np.float32).astype(np.float64))
    assert (np.abs(logs - exact) <= 2e-7 * np.maximum(1, exact)).all()


@numba.njit
def _functions(x, y):  # type: ignore[no-untyped-def]
    return np.array([inverse_root(a) for a in x]), np.array([log_of(a) for a in y])


def test_no_pixels_and_no_lights() -> None:
    world, family = renderers.load_scene("cornell-box").world(), FAMILIES["c0"]
    g = cast_gbuffer(world, SIZE)
    none = np.zeros((21, 0), np.float32)
    assert not splat(g, world, none, family, 0.0).any()
    empty = GBuffer(g.position, g.normal, g.base, g.emission, np.full_like(g.triangle, -1), g.material, g.eye)
    vpls = lights(4)
    for caster in (None, caster_of(world)):
        assert not splat(empty, world, light_rows(vpls, family, np.ones(4)), family, 0.0, caster).any()


@pytest.mark.parametrize("side", [2, 4, 8])
def test_the_filter_is_its_definition(side: int) -> None:
    """Tent, power of the cosine and Gaussian of the distance to the plane, one shift of the image after another in float64."""
    g = cast_gbuffer(renderers.load_scene("colonnade").world(), (40, 24))
    image = generator(3, "light").random((24, 40, 3)).astype(np.float32)
    x, n, covered = (np.pad(a, side) if a.ndim == 2 else np.pad(a, ((side, side), (side, side), (0, 0))) for a in
                     (g.position.astype(np.float64), g.normal.astype(np.float64), g.covered))  # fmt: skip
    light, total, weight = np.pad(image, ((side, side), (side, side), (0, 0))), np.zeros(image.shape), np.zeros((24, 40))
    for v in range(1 - side, side):
        for u in range(1 - side, side):
            here = slice(side + v, side + v + 24), slice(side + u, side + u + 40)
            apart = np.einsum("ijk,ijk->ij", g.normal, x[here] - g.position) / 0.01
            cosine = np.maximum(np.einsum("ijk,ijk->ij", g.normal.astype(np.float64), n[here]), 0)
            w = (side - abs(u)) * (side - abs(v)) * cosine**32 * np.exp(-(apart**2)) * covered[here]
            weight += w
            total += w[..., None] * light[here]
    expected = np.where(g.covered[..., None], total / np.where(g.covered, weight, 1)[..., None], 0)
    # Gaussians carry 3e-7, their arguments a few roundings of a distance over 1 % of the World; both stand above and below the bar
    np.testing.assert_allclose(joined(image, g, side), expected, atol=1e-5)


def test_sub_images_are_the_image_and_the_filter_keeps_flat_light() -> None:
    world = renderers.load_scene("cornell-box").world()
    g = cast_gbuffer(world, (48, 28))
    whole = np.zeros_like(g.position)
    for place, part in sub_images(g, 4):
        assert part.size == (12, 7)
        whole[place] = part.position
        origins, directions = world.camera.rays(part.size, part.offset)
        expected = part.position[part.covered] - origins[part.covered]
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(directions[part.covered], expected, atol=2e-6)
    np.testing.assert_array_equal(whole, g.position)
    flat = np.where(g.covered[..., None], np.float32(3), np.float32(0))
    np.testing.assert_allclose(joined(flat, g, 4), flat, rtol=1e-6)
    with pytest.raises(ValueError, match="divisible by 4"):
        next(sub_images(cast_gbuffer(world, SIZE), 4))
