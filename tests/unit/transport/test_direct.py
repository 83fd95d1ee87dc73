"""Direct light: closed forms, and Mitsuba's path tracer at depth 2."""

from collections import Counter

import numpy as np
import pytest

import renderers
from renderers.gbuffer import GBuffer
from renderers.images import luminance
from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.model import DirectionalLight, Environment, Lambert, Phong, PointLight, Scene, SpotLight
from renderers.transport.brdf import evaluate, materials_at
from renderers.transport.direct import direct, emitted, irradiance
from renderers.transport.primary import cast_gbuffer

SIZE = (48, 27)


def room(sky: Environment | None = None, lamp: bool = False, light: object = None) -> Scene:
    """A plane with a box on it, under what lights are asked for."""
    b = SceneBuilder("room")
    grey, red = b.material(Lambert("grey", (0.6, 0.6, 0.6))), b.material(Lambert("red", (0.7, 0.2, 0.1)))
    b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], grey)
    ring = [(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)]
    b.quad([(x, 0.8, z) for x, z in ring], red)
    for (ax, az), (bx, bz) in zip(ring, ring[1:] + ring[:1], strict=True):
        b.quad([(ax, 0, az), (bx, 0, bz), (bx, 0.8, bz), (ax, 0.8, az)], red)
    if lamp:
        glow = b.material(Lambert("lamp", (0.2, 0.2, 0.2), emission=(4.0, 3.0, 2.0), double_sided=False))
        b.quad([(1.0, 1.5, -0.5), (1.8, 1.5, -0.5), (1.8, 1.5, 0.5), (1.0, 1.5, 0.5)], glow)
    if light is not None:
        b.light(light, (1.0, 2.0, 1.0), look_rotation(np.array([-1.0, -2.0, -1.5])))  # type: ignore[arg-type]
    b.environment = sky
    b.camera((1.5, 2.5, 4.0), (0, 0.3, 0), 0.7)
    return b.build()


def image(height: int = 16, width: int = 32) -> np.ndarray:
    values = np.full((height, width, 3), 0.2, np.float32)
    values[3:5, 6:9] = 30
    return values


def test_point_light_on_a_plane_has_its_closed_form() -> None:
    b = SceneBuilder("plane")
    b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], b.material(Lambert("grey", (0.5, 0.5, 0.5))))
    b.light(PointLight("lamp", (1.0, 0.5, 0.25), 8.0), (0.3, 1.5, 0.2))
    b.camera((0, 3, 0.01), (0, 0, 0), 0.6)
    world = b.build().world()
    g = cast_gbuffer(world, SIZE)
    metres = g.position.reshape(-1, 3) / world.scale + world.centre
    towards = np.array([0.3, 1.5, 0.2]) - metres
    r2 = np.einsum("ij,ij->i", towards, towards)
    exact = 0.5 / np.pi * 8.0 * towards[:, 1] / r2**1.5
    np.testing.assert_allclose(direct(world, g).reshape(-1, 3)[:, 0], exact, rtol=1e-5)
    np.testing.assert_allclose(direct(world, g)[..., 2] * 4, direct(world, g)[..., 0], rtol=1e-5)


def test_spot_light_falls_off_as_gltf_says() -> None:
    inner, outer = 0.2, 0.5
    b = SceneBuilder("plane")
    b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], b.material(Lambert("white", (1.0, 1.0, 1.0))))
    b.light(
        SpotLight("spot", intensity=5.0, inner_angle=inner, outer_angle=outer), (0, 2, 0), look_rotation(np.array([0, -1, 0.0]))
    )
    b.camera((0, 3, 0.01), (0, 0, 0), 0.6)
    world = b.build().world()
    g = cast_gbuffer(world, SIZE)
    metres = g.position.reshape(-1, 3) / world.scale + world.centre
    r2 = metres[:, 0] ** 2 + metres[:, 2] ** 2 + 4
    cosine = 2 / np.sqrt(r2)
    falloff = np.clip((cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer)), 0, 1) ** 2
    assert 0 < np.count_nonzero(falloff == 0) < falloff.size
    np.testing.assert_allclose(direct(world, g).reshape(-1, 3)[:, 0], falloff / np.pi * 5 * cosine / r2, rtol=1e-5, atol=1e-6)


@pytest.mark.mitsuba
@pytest.mark.parametrize("light", ["point", "directional", "cornell"])
def test_punctual_lights_match_mitsuba(light: str) -> None:
    from tests.unit.transport.mitsuba_world import path_traced

    kinds = {"point": PointLight("p", (1.0, 0.8, 0.6), 6.0), "directional": DirectionalLight("d", (1.0, 0.8, 0.6), 3.0)}
    scene = renderers.load_scene("cornell-box") if light == "cornell" else room(light=kinds[light])
    world = scene.world()
    g = cast_gbuffer(world, (96, 54))
    ours = direct(world, g) + emitted(world, g)
    theirs, _ = path_traced(world, (96, 54), 2, 1)
    a, b = luminance(ours), luminance(theirs)
    agree = np.abs(a - b) <= 1e-3 * b
    assert agree.mean() >= 0.99


@pytest.mark.mitsuba
@pytest.mark.parametrize("case", ["lamp", "constant", "map", "all"])
def test_area_lights_and_sky_match_mitsuba(case: str) -> None:
    """z-scores over pixels and channels of two independent noisy estimates of one image."""
    from tests.unit.transport.mitsuba_world import path_traced

    sky = {"constant": Environment((0.5, 0.7, 1.0)), "map": Environment((1.0, 0.9, 0.8), image(), (0.1, 0.5, -0.2, 0.8))}
    sky["all"] = sky["map"]
    world = room(sky.get(case), lamp=case in ("lamp", "all")).world()
    g = cast_gbuffer(world, SIZE)
    runs = np.stack([direct(world, g, 64, seed) + emitted(world, g) for seed in range(8)]).astype(np.float64)
    ours, our_error = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    theirs, their_error = path_traced(world, SIZE, 2, 256)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=4e-3)
    error = np.sqrt(our_error**2 + their_error**2) + 1e-5 * theirs
    z = (ours - theirs)[error > 0] / error[error > 0]
    # Our error comes of 8 runs (t-distributed, fat tails), theirs of heavy-tailed samples: 99 % within 4.5 of t_7 is the bar.
    assert np.mean(np.abs(z) < 4.5) > 0.99
    assert abs(np.mean(z)) < 0.15


def test_emitters_shine_from_their_front_unless_double_sided() -> None:
    def brightness(double_sided: bool) -> float:
        b = SceneBuilder("lamp above, facing up")
        b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], b.material(Lambert("grey")))
        glow = b.material(Lambert("lamp", emission=(1.0, 1.0, 1.0), double_sided=double_sided))
        b.quad([(-0.5, 1, 0.5), (0.5, 1, 0.5), (0.5, 1, -0.5), (-0.5, 1, -0.5)], glow)
        b.camera((0, 0.5, 3), (0, 0, 0), 0.6)
        world = b.build().world()
        return float(direct(world, cast_gbuffer(world, SIZE)).sum())

    assert brightness(double_sided=False) == 0
    assert brightness(double_sided=True) > 0


def test_glossy_receivers_use_their_brdf() -> None:
    b = SceneBuilder("glossy")
    b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], b.material(Phong("p", (0.3, 0.2, 0.1), (0.4, 0.5, 0.6), 30.0)))
    b.light(DirectionalLight("sun", intensity=2.0), rotation=look_rotation(np.array([0.0, -1.0, -1.0])))
    b.camera((0, 3, -3), (0, 0, 0), 0.6)
    world = b.build().world()
    g = cast_gbuffer(world, SIZE)
    n = g.normal.reshape(-1, 3).astype(np.float64)
    view = g.eye - g.position.reshape(-1, 3)
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    light = np.tile(np.array([0, 1, 1]) / np.sqrt(2), (len(n), 1))
    f = evaluate(materials_at(world.materials, g.material.ravel(), g.base.reshape(-1, 3)), n, light, view)
    np.testing.assert_allclose(direct(world, g).reshape(-1, 3), f * 2 / np.sqrt(2), rtol=1e-4)


def test_irradiance_of_a_constant_sky_is_pi_and_rays_are_counted() -> None:
    b = SceneBuilder("open")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert("grey")))
    b.camera((0, 1, 3), (0, 0, 0), 0.6)
    b.environment = Environment((1.0, 2.0, 0.0))
    counters = Counter[str]()
    up = np.array([[0.0, 1.0, 0.0]])
    e = irradiance(b.build().world(), np.zeros((1, 3)), up, up, 8, counters=counters)
    np.testing.assert_allclose(e, [[np.pi, 2 * np.pi, 0]], rtol=1e-9)
    assert counters["rays"] == 8


def test_seed_moves_only_noise() -> None:
    world = room(lamp=True).world()
    g: GBuffer = cast_gbuffer(world, SIZE)
    a, b, again = direct(world, g, 4, 1), direct(world, g, 4, 2), direct(world, g, 4, 1)
    np.testing.assert_array_equal(a, again)
    assert not np.array_equal(a, b)
    assert a.mean() == pytest.approx(b.mean(), rel=0.02)
