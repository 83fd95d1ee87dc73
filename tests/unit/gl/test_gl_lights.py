"""Light samples add up to the light they stand for (no GL needed)."""

from __future__ import annotations

import numpy as np
import pytest
from gl_oracle import room

from renderers.gl.lights import light_samples
from renderers.scene.builder import SceneBuilder
from renderers.scene.environment import radiance
from renderers.scene.model import DiscLight, Environment, Lambert, PointLight, SphereLight
from renderers.scene.world import World


def sky(environment: Environment) -> World:
    b = SceneBuilder("sky")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert()))
    b.environment = environment
    b.camera((0, 1, 3), (0, 0, 0), 0.6)
    return b.build().world()


@pytest.mark.parametrize("count", [1, 7, 64])
def test_area_samples_carry_radiance_times_area(count):
    world = room(emission=(2.0, 4.0, 8.0)).world()
    samples = light_samples(world, count)
    area = world.areas[world.emissive].sum()
    assert len(samples) == count
    assert np.allclose(sum(s.intensity for s in samples), area * np.array([2.0, 4.0, 8.0]), rtol=1e-6)
    assert np.allclose([s.axis for s in samples], [0, -1, 0], atol=1e-6)


def test_lamps_of_any_shape_share_samples_by_power():
    identity = (0.0, 0.0, 0.0, 1.0)
    world = room(
        (DiscLight("disc", intensity=1.0, radius=0.3), (0, 2, 0), identity),
        (SphereLight("ball", intensity=3.0, radius=0.2), (1, 2, 0), identity),
    ).world()
    samples = light_samples(world, 200)
    power = {"disc": np.pi * 0.3**2 * 1.0, "ball": 4 * np.pi * 0.2**2 * 3.0}
    centre = (np.array([1, 2, 0]) - world.centre) * world.scale
    near_ball = [s for s in samples if np.linalg.norm(s.position - centre) < 0.25 * world.scale]
    assert abs(len(near_ball) / 200 - power["ball"] / sum(power.values())) < 0.01
    assert np.allclose(sum(s.intensity for s in samples), sum(power.values()) * world.scale**2, rtol=1e-3)


def test_emitters_of_both_sides_send_both_ways():
    b = SceneBuilder("two-sided")
    lamp = b.material(Lambert("lamp", (0, 0, 0), emission=(1.0, 1.0, 1.0), double_sided=True))
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], lamp)
    b.camera((0, 1, 3), (0, 0, 0), 0.6)
    samples = light_samples(b.build().world(), 8)
    assert sorted(s.axis[1] for s in samples) == pytest.approx([-1] * 4 + [1] * 4)


def test_dark_lights_are_left_out():
    world = room((PointLight("off", intensity=0.0), (0, 1, 0), (0, 0, 0, 1))).world()
    assert light_samples(world, 16) == []


def test_constant_sky_sums_to_the_sphere():
    samples = light_samples(sky(Environment((1.0, 0.5, 0.25))), 100)
    assert np.allclose(sum(s.intensity for s in samples), 4 * np.pi * np.array([1.0, 0.5, 0.25]))
    assert np.linalg.norm(np.mean([s.axis for s in samples], axis=0)) < 0.03


def test_image_sky_sums_to_its_integral():
    image = np.random.default_rng(0).random((6, 12, 3)).astype(np.float32) ** 4
    environment = Environment((2.0, 2.0, 2.0), image)
    samples = light_samples(sky(environment), 4096)
    y, a = np.meshgrid(1 - 2 * (np.arange(400) + 0.5) / 400, (np.arange(800) + 0.5) / 800 * 2 * np.pi, indexing="ij")
    s = np.sqrt(1 - y**2)
    grid = np.stack([s * np.sin(a), y, -s * np.cos(a)], axis=-1).reshape(-1, 3)
    integral = radiance(environment, grid).mean(axis=0) * 4 * np.pi
    # p follows the brightest corner of a cell, up to a few times the radiance inside it; 4,096 strata of a smooth remainder
    assert np.allclose(sum(x.intensity for x in samples), integral, rtol=0.01)


def test_one_bright_texel_shines_from_where_mitsuba_puts_it():
    """Texel (row 1, column 2) of 4 × 8: azimuth atan2(x, -z) = 2.5/8 turn, polar angle 1/3 of π (measured on Mitsuba's envmap)."""
    image = np.zeros((4, 8, 3), np.float32)
    image[1, 2] = 1
    azimuth, polar = 2.5 / 8 * 2 * np.pi, np.pi / 3
    direction = np.array([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)])
    assert radiance(Environment((1, 1, 1), image), direction[None])[0] == pytest.approx([1, 1, 1])
    half_turn = (0.0, 1.0, 0.0, 0.0)
    for rotation, sign in (((0.0, 0.0, 0.0, 1.0), 1), (half_turn, -1)):
        samples = light_samples(sky(Environment((1, 1, 1), image, rotation)), 256)
        mean = -np.average([s.axis for s in samples], axis=0, weights=[s.intensity[0] for s in samples])
        mean /= np.linalg.norm(mean)
        assert mean[[0, 2]] == pytest.approx(sign * direction[[0, 2]], abs=0.1)
