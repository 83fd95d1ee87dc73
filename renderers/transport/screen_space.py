"""Directional occlusion and one bounce in screen space (Ritschel, Grosch & Seidel 2009). Twin of `renderers.gl.screen_space`.

A pixel's samples stand at P + λ_i ω_i, λ_i ≤ r_max. One that lies behind the surface Q seen in its own pixel is blocked by it:

    sky(P)    = Σ_i f_r cos θ_i · L_sky(ω_i) · (1 - B_i) · 2π/N
    bounce(P) = Σ_i f_r · L_Q · B_i · cos θ_P cos θ_Q / max(ε, |PQ|²) · π r_max²/N
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.environment import radiance
from renderers.scene.world import World
from renderers.transport.brdf import evaluate
from renderers.transport.gather import pixels_of
from renderers.transport.sampling import generator, uniform_numbers

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Search(NamedTuple):
    """How pixels look around. pattern float32 (s², N, 4): direction about +Z and share of the radius, for each place of an s × s
    block of pixels; radius: r_max, World units; bias: least sine of a blocker's height over the receiver's horizon."""

    pattern: F32
    radius: float
    bias: float

    @property
    def side(self) -> int:
        """s."""
        return int(np.sqrt(len(self.pattern)))


def sample_pattern(count: int, side: int, seed: int) -> F32:
    """Uniform directions of the hemisphere about +Z and uniform shares of the radius, float32 (side², count, 4).

    Aligned stretches of one scrambled Sobol' set: each place's samples are even, and so are those of the whole block.
    """
    numbers = uniform_numbers(count * side * side, 3, generator(seed, "screen space"), "low-discrepancy")
    numbers = numbers.reshape(side * side, count, 3)
    z, azimuth = numbers[..., 0], 2 * np.pi * numbers[..., 1]
    sine = np.sqrt(1 - z**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z, numbers[..., 2]], axis=-1).astype(np.float32)


def sky(gbuffer: GBuffer, world: World, search: Search) -> F32:
    """Light of the environment that no visible surface within the radius blocks, reflected to the eye, float32 (H, W, 3)."""
    if world.environment is None:
        return np.zeros((*gbuffer.triangle.shape, 3), np.float32)
    pixels, total = pixels_of(gbuffer, world), None
    normal = pixels.normal.astype(np.float64)
    for direction, blocked, _ in _samples(gbuffer, world, search):
        light = radiance(world.environment, direction) * (~blocked * np.einsum("ij,ij->i", normal, direction))[:, None]
        part = evaluate(pixels.materials, normal, direction, pixels.view) * light
        total = part if total is None else total + part
    return _image(gbuffer, total * (2 * np.pi / search.pattern.shape[1]))


def bounce(gbuffer: GBuffer, world: World, search: Search, senders: F32, eps_b: float) -> F32:
    """Light that the blockers of each pixel send to it, float32 (H, W, 3). senders (H, W, 3): radiance that leaves each pixel."""
    pixels, total = pixels_of(gbuffer, world), None
    normal, sent = pixels.normal.astype(np.float64), senders.reshape(-1, 3).astype(np.float64)
    positions, normals = gbuffer.position.reshape(-1, 3).astype(np.float64), gbuffer.normal.reshape(-1, 3).astype(np.float64)
    area = np.pi * search.radius**2 / search.pattern.shape[1]
    for _, blocked, seen in _samples(gbuffer, world, search):
        way = positions[seen] - pixels.position
        r2 = np.maximum(np.einsum("ij,ij->i", way, way), 1e-18)
        light = way / np.sqrt(r2)[:, None]
        cosines = np.maximum(np.einsum("ij,ij->i", normal, light), 0) * np.maximum(-np.einsum("ij,ij->i", normals[seen], light), 0)
        weight = np.where(blocked, cosines / np.maximum(r2, eps_b) * area, 0)
        part = evaluate(pixels.materials, normal, light, pixels.view) * sent[seen] * weight[:, None]
        total = part if total is None else total + part
    return _image(gbuffer, total)


def _image(gbuffer: GBuffer, values: F64 | None) -> F32:
    image = np.zeros((*gbuffer.triangle.shape, 3), np.float32)
    image[gbuffer.covered] = 0 if values is None else values
    return image


def _samples(gbuffer: GBuffer, world: World, search: Search):  # type: ignore[no-untyped-def]
    """For each of the N samples of all covered pixels: directions (P, 3), whether blocked (P,), and the flat pixel met (P,)."""
    rows = np.flatnonzero(gbuffer.covered)
    width, height = gbuffer.size
    y, x = np.divmod(rows, width)
    place = (y % search.side) * search.side + x % search.side
    position, normal = gbuffer.position.reshape(-1, 3)[rows], gbuffer.normal.reshape(-1, 3)[rows]
    frame = _frames(normal)
    camera = world.camera.pose
    tangent = np.tan(world.camera.yfov / 2)
    scale = np.array([height / (2 * tangent), -height / (2 * tangent)])
    depths = -(gbuffer.position.reshape(-1, 3) - camera[:3, 3]) @ camera[:3, 2]
    for k in range(search.pattern.shape[1]):
        local = search.pattern[place, k]
        direction = np.einsum("nij,ni->nj", frame, local[:, :3]).astype(np.float64)
        at = (position + direction * (local[:, 3] * search.radius)[:, None] - camera[:3, 3]) @ camera[:3, :3]
        depth = -at[:, 2]
        ahead = depth > 0
        pixel = at[:, :2] / np.where(ahead, depth, 1)[:, None] * scale + np.array([width, height]) / 2
        column, row = np.floor(pixel + 0.5 - np.array(gbuffer.offset)).astype(np.int64).T
        inside = ahead & (column >= 0) & (row >= 0) & (column < width) & (row < height)
        seen = np.where(inside, row * width + column, rows)
        way = gbuffer.position.reshape(-1, 3)[seen] - position
        above = np.einsum("ij,ij->i", way, normal) > search.bias * np.linalg.norm(way, axis=1)
        yield direction, inside & gbuffer.covered.ravel()[seen] & (depths[seen] < depth) & above, seen


def _frames(normal: F32) -> F64:
    """Rows: two axes across the unit normal, and the normal itself, (P, 3, 3) (Duff et al. 2017)."""
    x, y, z = normal.astype(np.float64).T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    across = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1), np.stack([b, sign + y * y * a, -y], axis=1)
    return np.stack([*across, normal], axis=1)
