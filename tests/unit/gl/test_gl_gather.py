"""The gather pass against the same sum in numpy float64."""

from __future__ import annotations

import numpy as np
import pytest
from gl_oracle import F32_STEP, brdf, pixels, room

from renderers.gl.gather import BATCH, gather
from renderers.gl.gbuffer import render_gbuffer, render_resident
from renderers.scene.load import load_scene
from renderers.scene.world import World

pytestmark = pytest.mark.gl
SIZE = (40, 30)


def lights_on_surfaces(world: World, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    triangle = rng.integers(len(world.triangles), size=count)
    positions = np.einsum("nc,nck->nk", rng.dirichlet(np.ones(3), count), world.positions[world.triangles[triangle]].astype(float))
    normals = world.face_normals[triangle] * rng.choice([-1, 1], count)[:, None]
    return positions.astype(np.float32), normals.astype(np.float32), (rng.random((count, 3)) / count).astype(np.float32)


def expected(world, gbuffer, positions, normals, intensities, eps_b):
    """The sum, and the sum of the same terms with both cosines 1.

    Rounding of a cosine is absolute, 2⁻²⁴ of a unit vector's length.
    """
    p = pixels(world, gbuffer)
    total, ceiling = np.zeros_like(p["position"]), np.zeros_like(p["position"])
    for y, n, i in zip(positions.astype(float), normals.astype(float), intensities.astype(float), strict=True):
        d = y - p["position"]
        r2 = np.sum(d * d, axis=-1)
        keep = r2 >= 1e-20
        r2 = np.where(keep, r2, 1)
        l = d / np.sqrt(r2)[:, None]  # noqa: E741
        f = brdf(world, p["material"], p["base"], p["normal"], p["view"], l)
        receiver = np.maximum(np.sum(p["normal"] * l, axis=-1), 0)
        geometry = receiver * np.maximum(-l @ n, 0) / np.maximum(eps_b, r2) * keep
        total += np.where((geometry > 0)[:, None], f * geometry[:, None] * i, 0)
        ceiling += np.where(receiver[:, None] > 0, f, 0) / np.maximum(eps_b, r2)[:, None] * i * keep[:, None]
    return total, ceiling


@pytest.mark.parametrize("eps_b", [0.0, 1e-4, 0.1])
def test_lambert_sum_matches_float64(eps_b):
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE)
    lights = lights_on_surfaces(world, BATCH + 100)
    image = gather(g, world, *lights, eps_b)
    total, ceiling = expected(world, g, *lights, eps_b)
    # A term takes some 30 float32 operations, a batch adds up to BATCH of them: at most (BATCH + 30) roundings of the growing sum.
    assert np.all(np.abs(image[g.covered] - total) <= (BATCH + 30) * F32_STEP * ceiling)
    assert np.quantile(np.abs(image[g.covered] - total) / np.maximum(total, total.mean()), 0.99) < 1e-5
    assert not image[~g.covered].any()


def test_every_brdf_matches_float64():
    world = room().world()
    g = render_gbuffer(world, SIZE)
    lights = lights_on_surfaces(world, 200)
    image = gather(g, world, *lights, 1e-3)
    total, _ = expected(world, g, *lights, 1e-3)
    assert {0, 1, 2} <= set(world.materials.kind[g.material[g.covered]])
    # Lobes multiply a vector's rounding by the slope of their logarithm, at most exponent = 30 (Phong) and 4/α = 33 (GGX):
    # 33 · 6e-8 · some 30 operations = 6e-5 of a term at the lobe's edge.
    assert np.all(np.abs(image[g.covered] - total) <= 1e-4 * np.maximum(total, 0.1 * total.mean()))


def test_light_on_the_receiver_is_skipped():
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE)
    where = tuple(np.argwhere(g.covered)[100])
    y, n = g.position[where][None], -g.normal[where][None]
    image = gather(g, world, y, n, np.ones((1, 3)), 0.0)
    assert np.isfinite(image).all()
    assert not image[where].any()


def test_no_lights_give_black():
    world = load_scene("cornell-box").world()
    nothing = np.zeros((0, 3))
    assert not gather(render_gbuffer(world, SIZE), world, nothing, nothing, nothing, 0.0).any()


def test_resident_and_numpy_gbuffers_give_the_same_bytes():
    world = load_scene("cornell-box").world()
    lights = lights_on_surfaces(world, 50)
    resident = render_resident(world, SIZE)
    on_gpu = gather(resident, world, *lights, 1e-4)
    resident.release()
    assert on_gpu.tobytes() == gather(render_gbuffer(world, SIZE), world, *lights, 1e-4).tobytes()


def test_negative_bound_is_refused():
    world = load_scene("cornell-box").world()
    with pytest.raises(ValueError, match="eps_b"):
        gather(render_gbuffer(world, SIZE), world, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)), -1.0)
