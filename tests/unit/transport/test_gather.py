"""The gather kernels against plain numpy, with and without occlusion, and VPLs against irradiance."""

from collections import Counter

import numpy as np
import pytest

import renderers
from renderers.gbuffer import GBuffer
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import GGX, Lambert, Phong, PointLight
from renderers.scene.world import World
from renderers.transport.brdf import evaluate
from renderers.transport.gather import gather, pixels_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import caster_of, segments_blocked
from renderers.transport.sampling import generator, uniform_sphere
from renderers.transport.vpl import emit_vpls

SIZE = (20, 12)


def world_of(*materials: object) -> World:
    b = SceneBuilder("corner")
    floor, wall, back = (b.material(m) for m in materials)  # type: ignore[arg-type]
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], floor)
    b.quad([(-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1)], wall)
    b.quad([(-1, 0, 1), (-1, 0, -1), (-1, 2, -1), (-1, 2, 1)], back)
    b.quad([(-0.2, 0.5, 0.2), (0.3, 0.5, 0.2), (0.3, 0.6, -0.3), (-0.2, 0.6, -0.3)], floor)
    b.light(PointLight("lamp", intensity=2.0), (0.6, 1.5, 0.4))
    b.camera((1.5, 1.8, 3.5), (0, 0.6, 0), 0.7)
    return b.build().world()


DIFFUSE = (Lambert("a", (0.7, 0.6, 0.5)), Lambert("b", (0.2, 0.9, 0.4)), Lambert("c", (0.5, 0.5, 0.5)))
GLOSSY = (Lambert("a", (0.7, 0.6, 0.5)), Phong("b", (0.3, 0.2, 0.1), (0.3, 0.5, 0.2), 25.0), GGX("c", (0.9, 0.6, 0.3), 0.5, 0.4))


def lights(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = generator(9, "lights")
    positions = rng.uniform(-0.6, 0.6, (count, 3)).astype(np.float32)
    normals = uniform_sphere(rng.random((count, 2))).astype(np.float32)
    return positions, normals, rng.random((count, 3)).astype(np.float32)


def oracle(g: GBuffer, world: World, arrays: tuple[np.ndarray, ...], eps_b: float, occluded: bool) -> np.ndarray:
    """One light at a time, float64."""
    p = pixels_of(g, world)
    position, normal = p.position.astype(np.float64), p.normal.astype(np.float64)
    total = np.zeros((len(p.rows), 3))
    for y, ny, intensity in zip(*(a.astype(np.float64) for a in arrays), strict=True):
        v = y - position
        r2 = np.einsum("ij,ij->i", v, v)
        light = v / np.sqrt(r2)[:, None]
        cosines = np.maximum(0, np.einsum("ij,ij->i", light, normal)) * np.maximum(0, -(light @ ny))
        seen = np.ones(len(v), bool)
        if occluded:
            facing = np.flatnonzero(cosines > 0)
            seen[facing] = ~segments_blocked(
                caster_of(world), position[facing], p.geometric[facing], np.tile(y, (len(facing), 1)), np.tile(ny, (len(facing), 1))
            )
        weight = cosines * seen / np.maximum(eps_b, r2)
        total += evaluate(p.materials, normal, light, p.view) * weight[:, None] * intensity
    out = np.zeros((g.triangle.size, 3))
    out[p.rows] = total
    return out.reshape(*g.triangle.shape, 3)


@pytest.mark.parametrize("materials", [DIFFUSE, GLOSSY], ids=["diffuse", "glossy"])
@pytest.mark.parametrize("eps_b", [0.0, 0.01])
@pytest.mark.parametrize("occluded", [False, True])
def test_kernels_match_the_oracle(materials: tuple[object, ...], eps_b: float, occluded: bool) -> None:
    world = world_of(*materials)
    g = cast_gbuffer(world, SIZE)
    arrays = lights(3000 if not occluded else 300)
    counters = Counter[str]()
    ours = gather(g, world, *arrays, eps_b, caster_of(world) if occluded else None, counters)
    exact = oracle(g, world, arrays, eps_b, occluded)
    # float32 sums of up to 1024 positive terms per block, each of relative error about 10 ulp (6e-8): 1e-5 with margin. Occlusion
    # may flip for a pair whose shadow ray grazes an edge within float32 of a coordinate: such pixels are few.
    wrong = np.abs(ours - exact) > 1e-5 * exact + 1e-7
    assert wrong.mean() <= (0.01 if occluded else 0)
    assert ours.mean() == pytest.approx(exact.mean(), rel=1e-4)
    assert counters["light_evaluations"] == int(g.covered.sum()) * len(arrays[0])
    assert (counters["rays"] > 0) == occluded


def test_a_light_on_the_receiver_gives_nothing() -> None:
    world = world_of(*DIFFUSE)
    g = cast_gbuffer(world, SIZE)
    here = g.position[g.covered][:5]
    image = gather(g, world, here, -g.normal[g.covered][:5], np.ones((5, 3), np.float32), 0.0)
    assert np.isfinite(image).all()
    assert (image[g.covered][:5].max(axis=1) < 1e12).all()


def test_no_lights_no_light() -> None:
    world = world_of(*DIFFUSE)
    none = np.zeros((0, 3), np.float32)
    for caster in (None, caster_of(world)):
        assert not gather(cast_gbuffer(world, SIZE), world, none, none, none, 0.0, caster).any()


def test_vpls_carry_the_reflected_flux() -> None:
    """π Σ I estimates ∫ ρ E dA; for a point light in a closed white box of albedo ρ that is ρ · 4π I₀."""
    b = SceneBuilder("closed box")
    c = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    white = b.material(Lambert("white", (0.5, 0.5, 0.5)))
    for face in faces:
        b.quad(c[list(face)], white)
    b.light(PointLight("lamp", intensity=3.0), (0.2, -0.1, 0.3))
    b.camera((0, 0, 0.9), (0, 0, 0), 0.6)
    world = b.build().world()
    flux = []
    for seed in range(16):
        vpls = emit_vpls(world, 1024, seed)
        assert len(vpls) == vpls.drawn == 1024  # each point is lit on its inner side and on that only
        flux.append(np.pi * vpls.intensities.sum(axis=0)[0] / world.scale**2)
    assert abs(np.mean(flux) - 0.5 * 4 * np.pi * 3.0) < 4 * np.std(flux, ddof=1) / 4


def test_both_lit_sides_become_vpls() -> None:
    b = SceneBuilder("sheet between two lamps")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert("white")))
    b.light(PointLight("above"), (0, 1, 0))
    b.light(PointLight("below", intensity=2.0), (0, -1, 0))
    b.camera((0, 1, 3), (0, 0, 0), 0.6)
    vpls = emit_vpls(b.build().world(), 64)
    assert len(vpls) == 128
    up = vpls.normals[:, 1] > 0
    np.testing.assert_allclose(vpls.intensities[~up], 2 * vpls.intensities[up], rtol=1e-5)
    np.testing.assert_array_equal(vpls.index[up], vpls.index[~up])


def test_counters_and_bytes_repeat() -> None:
    world = renderers.load_scene("cornell-box").world()
    counters = Counter[str]()
    first, second = emit_vpls(world, 500, 3, counters=counters), emit_vpls(world, 500, 3)
    assert counters["vpls_drawn"] == 500
    assert counters["vpls_lit"] == len(first)
    assert first.intensities.tobytes() == second.intensities.tobytes()
