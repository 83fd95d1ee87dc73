"""Hemicubes drawn by OpenGL against the same ones cast by rays."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import Constant, room_2
from gl_oracle import room
from numpy.typing import NDArray

import renderers.gl.hemicube as gl_module
from renderers.gl.hemicube import FACES, LitHemicubes, Triangles
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Environment, Lambert, PointLight, SpotLight, Texture
from renderers.scene.world import World
from renderers.transport.caching import cube
from renderers.transport.caching.hemicube import HemicubeSampler
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import OFFSET, caster_of
from renderers.transport.sampling import frame

pytestmark = pytest.mark.gl
SIZE = 24


def seen_sites(world: World, every: int, size: tuple[int, int] = (32, 24)) -> Sites:
    gbuffer = cast_gbuffer(world, size)
    return Sites(*receivers_of(world, gbuffer, np.flatnonzero(gbuffer.covered)[::every]))


def drawn_triangles(world: World, here: Sites, size: int = SIZE) -> tuple[NDArray[np.int32], Counter[str]]:
    side, counters = np.einsum("kd,kd->k", here.normal, here.geometric), Counter[str]()
    lifts = np.where(side < 0, -1.0, 1.0)[:, None] * here.geometric
    axes = np.concatenate([np.stack(frame(here.normal), axis=1), here.normal[:, None]], axis=1)
    return Triangles(world, OFFSET)(here.position + OFFSET * lifts, lifts, axes, size, counters), counters


def cast_triangles(world: World, here: Sites, size: int = SIZE) -> NDArray[np.int32]:
    sampler = HemicubeSampler(world, size, Constant(1.0))
    origins, directions = sampler._rays(here, np.stack(frame(here.normal), axis=1), np.zeros(0))
    return caster_of(world).first_hit(origins, directions).triangle.reshape(len(here.position), -1)


def test_faces_are_those_of_the_tables() -> None:
    np.testing.assert_array_equal(FACES, cube.FACES)


def test_r29_texels_see_what_rays_through_their_centres_see() -> None:
    """Room 2: ≥ 99.5 % of the texels the same triangle, in one draw call; irradiance and distances of records as from rays."""
    world = room_2().world()
    here = seen_sites(world, 12)
    drawn, counters = drawn_triangles(world, here)
    assert (drawn == cast_triangles(world, here)).mean() >= 0.995
    assert counters["draw_calls"] == 1
    incoming = ReflectedDirectLight(world)
    cast, gl = (HemicubeSampler(world, SIZE, incoming, rasteriser=r)(here) for r in (None, Triangles(world, OFFSET)))
    assert np.sqrt(np.mean((gl.irradiance / cast.irradiance - 1) ** 2)) <= 0.005
    assert np.sqrt(np.mean((gl.radius / cast.radius - 1) ** 2)) <= 0.005


@pytest.mark.parametrize("kind", ["point", "spot", "lamp", "sky"])
def test_light_on_the_device_is_that_of_rays(kind: str) -> None:
    """All materials, curved shading normals, each kind of light: the mean irradiance of records within 1.5 % of what rays give.

    Each record's: within 3 % of the mean in the RMS where lights are punctual (1024² maps are wrong within a texel of edges), else
    not further from the mean of 4 seeds of rays than twice what single seeds are.
    """
    scene = {
        "point": room((PointLight("p", (1.0, 0.9, 0.8), 20.0), (1.0, 2.5, 1.0), (0.0, 0.0, 0.0, 1.0))),
        "spot": room((SpotLight("s", (1.0, 1.0, 1.0), 30.0, 0.3, 0.7), (0.0, 2.8, 1.5), (-0.38, 0.0, 0.0, 0.92))),
        "lamp": room(emission=(20.0, 18.0, 15.0)),
        "sky": replace(room(), environment=Environment((1.0, 1.2, 1.5))),
    }[kind]
    world = scene.world()
    here = seen_sites(world, 12)
    incoming = ReflectedDirectLight(world)
    seeds = [HemicubeSampler(world, SIZE, incoming, seed)(here).irradiance for seed in range(4 if kind in ("lamp", "sky") else 1)]
    cast, noise = np.mean(seeds, axis=0), np.sqrt(np.mean(np.var(seeds, axis=0)))
    lit = HemicubeSampler(world, SIZE, incoming, rasteriser=LitHemicubes(world, OFFSET))(here).irradiance
    scale = cast.mean()
    assert scale > 0
    assert np.sqrt(np.mean((lit - cast) ** 2)) <= max(0.03 * scale, 2 * noise)
    assert lit.mean() == pytest.approx(scale, rel=0.015)


def test_textures_of_what_is_seen() -> None:
    """Two textured walls with wraps of their own over a plain floor: light drawn is light cast, in each channel."""
    b = SceneBuilder("posters")
    rng = np.random.default_rng(7)
    for k, x in enumerate((-1.0, 0.0)):
        wall = b.material(Lambert(f"wall {k}", (0.9, 0.8, 0.7), texture=k))
        corners = [(x, 0, -1), (x + 1, 0, -1), (x + 1, 2, -1), (x, 2, -1)]
        b.node(meshes=(b.mesh(corners, [[0, 1, 2], [0, 2, 3]], wall, np.tile([0, 0, 1], (4, 1))),))
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert("floor", (0.5,) * 3)))
    b.light(PointLight("lamp", (1.0, 1.0, 1.0), 5.0), (0.2, 1.2, 0.4))
    b.camera((0, 1, 3), (0, 0.7, 0), 0.8)
    uvs = np.array([(-0.7, 1.6), (1.9, 1.6), (1.9, -0.8), (-0.7, -0.8)], np.float32)
    textures = tuple(
        Texture(f"t{k}", rng.integers(0, 256, (4, 3 + k, 3), dtype=np.uint8), wrap)
        for k, wrap in enumerate((("repeat", "mirror"), ("clamp", "repeat")))  # type: ignore[arg-type]
    )
    meshes = tuple(replace(m, uvs=uvs) if k < 2 else m for k, m in enumerate(b.meshes))
    world = replace(b.build(), meshes=meshes, textures=textures).world()
    assert len(world.textures) == 2
    here, incoming = seen_sites(world, 30), ReflectedDirectLight(world)
    cast = HemicubeSampler(world, SIZE, incoming)(here).irradiance
    lit = HemicubeSampler(world, SIZE, incoming, rasteriser=LitHemicubes(world, OFFSET))(here).irradiance
    # shadows between walls that meet reach a texel of the maps far: 2e-3 of the light
    np.testing.assert_allclose(lit, cast, atol=0.005 * cast.max())
    assert cast.max() > 0


def test_batches_give_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    world = room_2().world()
    here, incoming, counters = seen_sites(world, 40), ReflectedDirectLight(world), [Counter[str](), Counter[str]()]
    records = [HemicubeSampler(world, 8, incoming, rasteriser=LitHemicubes(world, OFFSET), counters=counters[0])(here)]
    monkeypatch.setattr(gl_module, "TEXELS", 3 * 8 * 8 * 5)
    records.append(HemicubeSampler(world, 8, incoming, rasteriser=LitHemicubes(world, OFFSET), counters=counters[1])(here))
    np.testing.assert_array_equal(records[0].irradiance, records[1].irradiance)
    np.testing.assert_array_equal(records[0].translation, records[1].translation)
    count = len(here.position)
    assert [c["draw_calls"] for c in counters] == [1, -(-count // 5)]
    assert counters[0]["texels"] == count * 3 * 64
    assert counters[0]["rays"] == 0


def test_own_surface_is_not_seen_below_a_tilted_normal() -> None:
    """A ball's shading normals lean away from its facets. Above a facet's plane texels see what rays see. Below it rays start
    inside the ball, drawn faces look past the facet from above: neither sees the facet itself, which would make radii vanish."""
    world = room((PointLight("p", (1.0, 1.0, 1.0), 20.0), (1.0, 2.5, 1.0), (0.0, 0.0, 0.0, 1.0))).world()
    here = seen_sites(world, 1, (64, 48))
    leaning = np.flatnonzero(np.abs(np.einsum("kd,kd->k", here.normal, here.geometric)) < 0.998)[::8]
    assert len(leaning) >= 10
    here = here.rows(leaning)
    sampler = HemicubeSampler(world, SIZE, Constant(1.0))
    _, directions = sampler._rays(here, np.stack(frame(here.normal), axis=1), np.zeros(0))
    side = np.where(np.einsum("kd,kd->k", here.normal, here.geometric) < 0, -1, 1)[:, None]
    above = side * np.einsum("kpd,kd->kp", directions.reshape(len(leaning), -1, 3), here.geometric) > 0
    drawn, _ = drawn_triangles(world, here)
    assert (drawn == cast_triangles(world, here))[above].mean() >= 0.995
    radii = [HemicubeSampler(world, SIZE, Constant(1.0), rasteriser=r)(here).radius for r in (None, Triangles(world, OFFSET))]
    assert (radii[1] >= 0.98 * radii[0]).all()


def test_nothing_to_see() -> None:
    """One triangle behind the record: no light, no distance."""
    world = room_2().world()
    out = Sites(np.array([[0.0, 0.0, 5.0]]), np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]))
    drawn, _ = drawn_triangles(world, out, 4)
    assert (drawn == -1).all()
    record = HemicubeSampler(world, 4, Constant(1.0), rasteriser=LitHemicubes(world, OFFSET))(out)
    assert np.isinf(record.radius[0])
    assert not record.irradiance.any()
