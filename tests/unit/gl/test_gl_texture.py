"""Base-colour textures in the G-buffer: exact decoding, bilinear filter, wrap modes, row 0 at v = 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderers.gl.gbuffer import render_gbuffer
from renderers.gl.upload import texture_runs
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, Scene, Texture

pytestmark = pytest.mark.gl
SIZE = (40, 30)
RNG = np.random.default_rng(7)
UVS = np.array([(-0.7, 1.6), (1.9, 1.6), (1.9, -0.8), (-0.7, -0.8)], np.float32)


def poster(*wraps: tuple[str, str]) -> Scene:
    """Unit quads side by side facing the camera, one texture each, uv from -0.7 to 1.9."""
    b = SceneBuilder("poster")
    for k in range(len(wraps)):
        m = b.material(Lambert(f"m{k}", (0.5, 1.0, 0.25), texture=k))
        x = k - len(wraps) / 2
        corners = [(x, -0.5, 0), (x + 1, -0.5, 0), (x + 1, 0.5, 0), (x, 0.5, 0)]
        b.node(meshes=(b.mesh(corners, [[0, 1, 2], [0, 2, 3]], m, np.tile([0, 0, 1], (4, 1))),))
    plain = b.material(Lambert("plain", (0.1, 0.2, 0.3)))
    b.quad([(-3, -2, -1), (3, -2, -1), (3, 2, -1), (-3, 2, -1)], plain)
    b.camera((0, 0, 2), (0, 0, 0), 0.9)
    textures = [Texture(f"t{k}", RNG.integers(0, 256, (5 + k, 7, 3), dtype=np.uint8), w) for k, w in enumerate(wraps)]  # type: ignore[arg-type]
    meshes = [replace(m, uvs=UVS) if k < len(wraps) else m for k, m in enumerate(b.meshes)]
    return replace(b.build(), meshes=tuple(meshes), textures=tuple(textures))


def wrapped(i: np.ndarray, n: int, mode: str) -> np.ndarray:
    if mode == "clamp":
        return np.clip(i, 0, n - 1)
    r = i % (n if mode == "repeat" else 2 * n)
    return np.where(r < n, r, 2 * n - 1 - r)


def looked_up(texture: Texture, uv: np.ndarray) -> np.ndarray:
    height, width = texture.pixels.shape[:2]
    p = uv * (width, height) - 0.5
    i, w = np.floor(p).astype(int), p - np.floor(p)
    total = 0
    for dx in (0, 1):
        for dy in (0, 1):
            texel = texture.linear[wrapped(i[:, 1] + dy, height, texture.wrap[1]), wrapped(i[:, 0] + dx, width, texture.wrap[0])]
            total = total + texel * (abs(1 - dx - w[:, 0]) * abs(1 - dy - w[:, 1]))[:, None]
    return total


def test_textures_match_numpy():
    wraps = [("repeat", "clamp"), ("mirror", "repeat"), ("clamp", "mirror")]
    scene = poster(*wraps)
    world = scene.world()
    g = render_gbuffer(world, SIZE)
    metres = g.position / world.scale + world.centre
    for k in range(len(wraps)):
        seen = g.material == k
        assert seen.sum() > 50
        s, t = metres[seen][:, 0] - (k - len(wraps) / 2), metres[seen][:, 1] + 0.5
        uv = np.stack([-0.7 + 2.6 * s, 1.6 - 2.4 * t], axis=1)
        expected = looked_up(scene.textures[k], uv) * np.array([0.5, 1.0, 0.25])
        # uv carries about 1e-6 (position and interpolation), times 7 texels across, times a contrast of 1
        assert np.abs(g.base[seen] - expected).max() < 2e-5
    assert np.allclose(g.base[g.material == len(wraps)], [0.1, 0.2, 0.3])


def test_row_0_is_at_v_0():
    scene = poster(("clamp", "clamp"))
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[0] = 255
    scene = replace(scene, textures=(replace(scene.textures[0], pixels=picture),))
    g = render_gbuffer(scene.world(), SIZE)
    rows = np.flatnonzero((g.material == 0).any(axis=1))
    assert g.base[rows[0]].max() == 1
    assert g.base[rows[-1]][g.material[rows[-1]] == 0].max() == 0


def test_runs_join_neighbours_of_one_texture():
    world = poster(("repeat", "repeat"), ("clamp", "clamp")).world()
    assert texture_runs(world) == ((0, 2, 0), (2, 2, 1), (4, 2, -1))
