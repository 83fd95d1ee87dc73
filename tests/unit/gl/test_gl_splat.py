"""Splatting against a loop over items and pixels."""

from __future__ import annotations

import numpy as np
import pytest
from gl_oracle import F32_STEP

import renderers.gl.splat as splat_module
from renderers import get_method
from renderers.gl.gbuffer import render_gbuffer
from renderers.gl.programs import compute
from renderers.gl.splat import splat
from renderers.scene.load import load_scene

pytestmark = pytest.mark.gl
SIZE = (48, 36)
SNIPPET = """
uniform float gain;
struct Item { vec4 sphere; float amount; };
Item item_at(int index) { return Item(item_texel(index, 0), payload(index, 0).y); }
bool misses(Node node, int index) { return false; }
vec4 contribution(Receiver receiver, Item item) {
    float w = 1.0 - distance(receiver.position, item.sphere.xyz) / item.sphere.w;
    return w < 0.0 ? vec4(0.0) : vec4(receiver.normal * item.amount * gain, w);
}
"""


def expected(g, centres, radii, payload, gain):
    """The sum, and for each pixel the distance to the nearest sphere's surface, where the inside test may go either way."""
    total, margin = np.zeros((*g.triangle.shape, 4)), np.full(g.triangle.shape, np.inf)
    for centre, radius, row in zip(centres.astype(float), radii.astype(float), payload, strict=True):
        distance = np.linalg.norm(g.position - centre, axis=-1)
        inside = g.covered & (distance <= radius)
        total[inside, :3] += g.normal[inside] * row[1] * gain
        total[inside, 3] += 1 - distance[inside] / radius
        margin = np.minimum(margin, np.abs(distance - radius))
    return total, margin


def check(world, g, centres, radii):
    centres, radii = np.asarray(centres, np.float32), np.asarray(radii, np.float32)
    payload = np.random.default_rng(1).random((len(radii), 2)).astype(np.float32)
    image, pairs = splat(g, world, centres, radii, payload, SNIPPET, {"gain": 0.5})
    total, margin = expected(g, centres, radii, payload, 0.5)
    sure = margin > 1e-6
    assert sure.mean() > 0.99
    assert pairs >= np.count_nonzero(total[..., 3])
    # Items of size ≤ 1 are added one by one: a rounding each for the sum, some ten inside the snippet.
    tolerance = 20 * F32_STEP * len(radii) * np.maximum(np.abs(total), 1)
    assert np.all(np.abs(image - total)[sure] <= tolerance[sure])
    return image


@pytest.mark.parametrize("offset", [(0.5, 0.5), (0.1, 0.8)])
def test_many_items_match_the_loop(offset):
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE, offset)
    rng = np.random.default_rng(5)
    centres = g.position[g.covered][rng.integers(g.covered.sum(), size=200)] + rng.normal(size=(200, 3)) * 0.05
    assert check(world, g, centres, rng.uniform(0.01, 0.4, 200))[..., 3].max() > 1


def test_spheres_around_beside_and_behind_the_camera():
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE)
    eye, pose = world.camera.pose[:3, 3], world.camera.pose
    right, up, back = pose[:3, 0], pose[:3, 1], pose[:3, 2]
    centres = [eye, eye + 0.2 * back, eye + 2 * back, eye + 3 * right - 0.5 * back, eye - 3 * up - 2 * back, eye + 5 * right]
    image = check(world, g, np.array(centres), np.array([2.5, 2.2, 1.0, 3.2, 2.9, 0.5]))
    assert image[..., 3].any()


def test_item_of_one_pixel_is_not_lost():
    world = load_scene("cornell-box").world()
    g = render_gbuffer(world, SIZE)
    where = np.argwhere(g.covered)[::37]
    centres = np.array([g.position[tuple(w)] for w in where])
    image = check(world, g, centres, np.full(len(centres), 1e-4))
    assert all(image[tuple(w)][3] > 0 for w in where)


def test_nothing_to_splat_is_black():
    world = load_scene("cornell-box").world()
    nothing = np.zeros((0, 3))
    image, pairs = splat(render_gbuffer(world, SIZE), world, nothing, np.zeros(0), np.zeros((0, 2)), SNIPPET, {"gain": 1.0})
    assert not image.any()
    assert pairs == 0


def test_sizes_that_tiles_do_not_divide_and_batches_change_nothing(monkeypatch):
    """Tiles are 8 wide, blocks 32: pictures that end inside of them; and 200 items at 64 a batch, the last one short."""
    world = load_scene("cornell-box").world()
    rng = np.random.default_rng(6)
    for size in ((33, 41), (8, 8), (7, 3)):
        g = render_gbuffer(world, size)
        centres = g.position[g.covered][rng.integers(g.covered.sum(), size=200)] + rng.normal(size=(200, 3)) * 0.05
        radii = rng.uniform(0.01, 0.4, 200)
        whole = check(world, g, centres, radii)
        with monkeypatch.context() as patch:
            patch.setattr(splat_module, "MOST", 64)
            np.testing.assert_array_equal(check(world, g, centres, radii), whole)


@pytest.mark.parametrize("family", ["c0", "linear", "ridge", "roulette"])
@pytest.mark.parametrize("scene", ["cornell-box", "cornell-glossy"])
def test_warm_up_compiles_all_that_a_frame_runs(scene, family):
    loaded, method = load_scene(scene), get_method("flc")
    settings = method.resolve(loaded, method.Settings(vpls=64, family=family, backend="gl"), "llvmpipe")
    method.warm_up(loaded.world(), settings)
    compiled = compute.cache_info().misses
    method.render(loaded, settings, size=(16, 9))
    assert compute.cache_info().misses == compiled
