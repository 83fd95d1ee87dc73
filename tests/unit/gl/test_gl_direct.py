"""Shadow-mapped direct light against the same formulas with Embree's shadow rays."""

from __future__ import annotations

import numpy as np
import pytest
from gl_oracle import Caster, brdf, pixels, room

from renderers.gl.direct import direct
from renderers.gl.gbuffer import render_gbuffer
from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.load import load_scene
from renderers.scene.model import DirectionalLight, Environment, Lambert, PointLight, SpotLight
from renderers.scene.world import World, WorldLight

pytestmark = pytest.mark.gl
SIZE = (80, 60)
DOWN = look_rotation(np.array([-0.3, -1.0, -0.4]))


def traced(world: World, g, light: WorldLight) -> np.ndarray:
    """Reflected light of one analytic light with exact visibility, float64 (N, 3) over covered pixels."""
    p = pixels(world, g)
    caster = Caster(world)
    if light.kind == "directional":
        towards = np.broadcast_to(-light.direction, p["position"].shape)
        irradiance = np.broadcast_to(light.intensity, towards.shape)
        l = towards  # noqa: E741
    else:
        towards = light.position - p["position"]
        r2 = np.sum(towards**2, axis=-1, keepdims=True)
        l = towards / np.sqrt(r2)  # noqa: E741
        shape = np.ones(len(l))
        if light.kind == "spot":
            shape = np.clip((-l @ light.direction - light.cos_outer) / (light.cos_inner - light.cos_outer), 0, 1) ** 2
        irradiance = light.intensity * shape[:, None] / r2
    free = caster.visible(p["position"], p["geometric"], towards, infinite=light.kind == "directional")
    cosine = np.maximum(np.sum(p["normal"] * l, axis=-1), 0) * free
    f = brdf(world, p["material"], p["base"], p["normal"], p["view"], l)
    return np.where(cosine[:, None] > 0, f, 0) * irradiance * cosine[:, None]


LIGHTS = {
    "point": (PointLight("l", (1.0, 0.8, 0.6), 8.0), (1.0, 2.4, 1.2), (0.0, 0.0, 0.0, 1.0)),
    "spot": (SpotLight("l", (1.0, 0.9, 0.7), 20.0, 0.2, 0.5), (0.8, 2.8, 1.5), DOWN),
    "wide spot": (SpotLight("l", (1.0, 0.9, 0.7), 20.0, 0.3, 1.4), (0.8, 2.8, 1.5), DOWN),
    "directional": (DirectionalLight("l", (1.0, 1.0, 0.9), 3.0), (0.0, 0.0, 0.0), DOWN),
}


def near_an_edge(world: World, g, light: WorldLight, texels: float, tangent: float) -> np.ndarray:
    """Pixels whose exact visibility changes somewhere within `texels` texel footprints of the light's ray to them, bool (N,).

    The ray is tilted and met with the receiver's own plane, as the map does. tangent: texel size over distance (directional:
    texel size).
    """
    p, caster = pixels(world, g), Caster(world)
    x, n = p["position"], p["geometric"]
    parallel = light.kind == "directional"
    ray = np.broadcast_to(light.direction, x.shape) if parallel else x - light.position
    step = texels * tangent * (1.0 if parallel else np.linalg.norm(ray, axis=-1, keepdims=True))
    across = np.cross(ray, np.where(np.abs(ray[:, :1]) > 0.5, [[0, 1, 0]], [[1, 0, 0]]))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    up = np.cross(across, ray / np.linalg.norm(ray, axis=-1, keepdims=True))
    seen = []
    for radius, angle in [(0, 0.0), *((r, a) for r in (0.4, 0.7, 1.0) for a in np.arange(16) / 16 * 2 * np.pi)]:
        side = radius * step * (np.cos(angle) * across + np.sin(angle) * up)
        start = x + side if parallel else light.position
        direction = ray if parallel else ray + side
        facing = np.sum(n * direction, axis=-1, keepdims=True)
        facing = np.where(np.abs(facing) < 1e-9, 1e-9, facing)
        moved = start + direction * np.sum(n * (x - start), axis=-1, keepdims=True) / facing
        seen.append(caster.visible(moved, n, -ray if parallel else light.position - moved, infinite=parallel))
    return np.logical_xor.reduce([np.any(seen, axis=0), np.all(seen, axis=0)])


# Texel size over distance at 1,024 texels: 2 tan(half angle) / 1,024, and a directional tile at most spans the World's diameter, 2.
TANGENT = {"point": 2 / 1024, "spot": 2 * np.tan(0.5) / 1024, "wide spot": 2 / 1024, "directional": 2 / 1024}


@pytest.mark.parametrize("name", LIGHTS)
def test_every_light_kind_matches_shadow_rays(name):
    world = room(LIGHTS[name]).world()
    light = world.lights[0]
    g = render_gbuffer(world, SIZE)
    image = direct(world, g, 1024)[g.covered]
    truth = traced(world, g, light)
    assert (truth.sum(-1) > 0).mean() > 0.1
    assert (truth.sum(-1) == 0).mean() > 0.05
    # A texel's centre is at most 0.71 texels from the receiver's ray, and the normal offset adds 0.25: wrong only within 1
    # texel of an edge.
    wrong = (image.sum(-1) > 0) != (truth.sum(-1) > 0)
    assert not np.any(wrong & ~near_an_edge(world, g, light, 1.0, TANGENT[name]))
    assert wrong.mean() < 0.02
    # float32 against float64; lobes amplify rounding as derived in test_gl_gather
    assert np.all(np.abs(image - truth)[~wrong] <= 1e-4 * np.maximum(truth[~wrong], 0.1 * truth.mean()))


@pytest.mark.parametrize("resolution", [256, 1024])
def test_cornell_box_shadows(resolution):
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE)
    truth = traced(world, g, world.lights[0])
    image = direct(world, g, resolution)[g.covered]
    wrong = (image.sum(-1) > 0) != (truth.sum(-1) > 0)
    assert not np.any(wrong & ~near_an_edge(world, g, world.lights[0], 1.0, 2 / resolution))
    # Shadow edges are some 4 World units long and the box shows about 4 units² of surface, so two texels' width of them
    # holds 4/resolution.
    assert np.abs(image - truth).sum() < 4 / resolution * truth.sum()


def test_percentage_closer_filtering_softens_edges_only():
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE)
    hard, soft = direct(world, g, 512), direct(world, g, 512, taps=1)
    share = np.divide(soft, hard, out=np.ones_like(soft), where=hard > 0)[..., 0]
    partial = (share > 0.05) & (share < 0.95)
    assert 0 < partial.mean() < 0.05
    assert abs(soft.sum() / hard.sum() - 1) < 0.01


def plate(emission: float) -> World:
    """Unit-square lamp facing down, 1 above a wide floor of albedo 1."""
    b = SceneBuilder("lamp over floor")
    floor = b.material(Lambert("floor", (1.0, 1.0, 1.0)))
    lamp = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=(emission,) * 3, double_sided=False))
    b.quad([(-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4)], floor)
    b.quad([(-0.5, 1, -0.5), (0.5, 1, -0.5), (0.5, 1, 0.5), (-0.5, 1, 0.5)], lamp)
    b.camera((0, 0.9, 3), (0, 0, 0), 0.9)
    return b.build().world()


def test_rectangular_lamp_reaches_the_closed_form():
    world = plate(5.0)
    g = render_gbuffer(world, SIZE)
    metres = g.position / world.scale + world.centre
    floor = (g.material == 0) & (np.abs(metres[..., 0]) < 2) & (np.abs(metres[..., 2]) < 2)
    x, z = metres[floor][:, 0], metres[floor][:, 2]

    def corner(a, b):
        """Form factor from a horizontal patch under the corner of an a × b rectangle at height 1, odd in a and b."""
        u, v = a / np.sqrt(1 + a * a), b / np.sqrt(1 + b * b)
        return (u * np.arctan(b / np.sqrt(1 + a * a)) + v * np.arctan(a / np.sqrt(1 + b * b))) / (2 * np.pi)

    form = corner(0.5 - x, 0.5 - z) + corner(0.5 + x, 0.5 - z) + corner(0.5 - x, 0.5 + z) + corner(0.5 + x, 0.5 + z)
    image = direct(world, g, 64, light_samples=64)[floor][:, 0]
    # L·F reflected by albedo 1; 64 points of a low-discrepancy set over a unit square at distance ≥ 1: about 1/64 of the value.
    assert np.abs(image / (5.0 * form) - 1).max() < 1 / 64
    assert not direct(world, g, 64, light_samples=4)[g.material == 1].any()


def test_open_floor_under_a_constant_sky():
    b = SceneBuilder("floor")
    b.quad([(-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4)], b.material(Lambert("floor", (0.5, 0.5, 0.5))))
    b.environment = Environment((1.0, 2.0, 3.0))
    b.camera((0, 2, 3), (0, 0, 0), 0.6)
    world = b.build().world()
    g = render_gbuffer(world, (16, 12))
    image = direct(world, g, 32, light_samples=256)[g.covered]
    # E = π L, reflected ρ L; 256 directions of a low-discrepancy set
    assert np.abs(image / (0.5 * np.array([1.0, 2.0, 3.0])) - 1).max() < 0.01


def test_what_a_world_lacks_costs_nothing():
    world = room().world()
    g = render_gbuffer(world, (16, 12))
    assert not direct(world, g).any()
