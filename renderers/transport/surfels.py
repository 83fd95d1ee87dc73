"""Surfels of deep screen space (Nalbach, Ritschel & Seidel 2014): pieces of all triangles, seen or not, that send light nearby.

Triangles are split in four until the longest edge of a piece looks no longer than some pixels from where the eye is; what is off
the screen or hidden is split alike. A piece is one surfel, with its area and the light that its centroid receives. Surfels light
the pixels within one radius:

    L(x) = Σ_{|x - y_j| ≤ R} f_r G_b(x, y_j) · ρ_j/π · E_j · A_j
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.gather import pixels_of
from renderers.transport.kernels import SAFE_R2, reflect
from renderers.transport.sampling import SurfacePoints
from renderers.transport.tiles import tiles_of
from renderers.transport.vpl import Vpls

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Pieces(NamedTuple):
    """Centroids of pieces, and their areas in World units² (N,)."""

    points: SurfacePoints
    area: F64


def pieces_of(world: World, height: int, pixels: float, levels: int) -> Pieces:
    """Pieces of all triangles, with edges of at most `pixels` of a picture `height` high, or 4^levels to a triangle."""
    step = 2 * np.tan(world.camera.yfov / 2) / height * pixels
    triangle = np.arange(len(world.triangles))
    corners = np.broadcast_to(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), (len(triangle), 3, 2))
    done: list[tuple[NDArray[np.int64], F64, int]] = []
    for level in range(levels + 1):
        whole = np.ones(len(triangle), bool) if level == levels else _small(world, triangle, corners, step)
        done.append((triangle[whole], corners[whole].mean(axis=1), level))
        triangle, corners = np.repeat(triangle[~whole], 4), _quarters(corners[~whole])
        if not len(triangle):
            break
    centre = np.concatenate([part for _, part, _ in done])
    index = np.concatenate([part for part, _, _ in done])
    area = np.concatenate([world.areas[part] / 4.0**level for part, _, level in done])
    return Pieces(SurfacePoints(index, centre[:, 0], centre[:, 1]), area)


def _small(world: World, triangle: NDArray[np.int64], corners: F64, step: float) -> NDArray[np.bool_]:
    """Whether the longest edge is at most `step` times the distance of the centroid from the eye."""
    vertices = world.positions[world.triangles[triangle]].astype(np.float64)
    weights = np.concatenate([1 - corners.sum(axis=2, keepdims=True), corners], axis=2)
    points = np.einsum("nkv,nvc->nkc", weights, vertices)
    longest = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).max(axis=1)
    return np.asarray(longest <= step * np.linalg.norm(points.mean(axis=1) - world.camera.pose[:3, 3], axis=1))


def _quarters(corners: F64) -> F64:
    """Four congruent parts of each triangle, (N, 3, 2) → (4 N, 3, 2)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.stack(parts, axis=1).reshape(-1, 3, 2)


def splat_surfels(
    gbuffer: GBuffer, world: World, surfels: Vpls, radius: float, eps_b: float, counters: Counter[str] | None = None
) -> F32:
    """Light of all surfels within `radius`, float32 (H, W, 3), 0 on the background. Twin of `renderers.gl.surfels`.

    The same bytes at any thread count. counters: adds `light_evaluations` (pairs computed) and `pixels_touched` (lit pairs).
    """
    pixels = pixels_of(gbuffer, world)
    tiles = tiles_of(pixels.rows, gbuffer.size[0], pixels.position, pixels.normal)
    lights = np.ascontiguousarray(np.concatenate([surfels.positions, surfels.normals, surfels.intensities], axis=1))
    total, work = np.zeros((len(pixels.rows), 3)), np.zeros((len(tiles.pixel), 2), np.int64)
    _splat(tiles.pixel, tiles.tile_bounds, pixels.receivers, lights, np.float32(radius), np.float32(eps_b), total, work)
    if counters is not None:
        counters["light_evaluations"] += int(work[:, 0].sum())
        counters["pixels_touched"] += int(work[:, 1].sum())
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[pixels.rows] = total
    return image.reshape(*gbuffer.triangle.shape, 3)


@numba.njit(parallel=True, cache=True)
def _splat(pixel, balls, pixels, lights, radius, eps_b, out, work):  # type: ignore[no-untyped-def]
    """out (P, 3) float64 += Σ f G_b I of the lights within the radius; each tile walks through all lights in order."""
    position, normal = pixels.position, pixels.normal
    for tile in numba.prange(len(pixel)):
        weight = np.empty(3)
        for j in range(len(lights)):
            y = lights[j]
            ax, ay, az = y[0] - balls[tile, 0], y[1] - balls[tile, 1], y[2] - balls[tile, 2]
            reach = radius + balls[tile, 3]
            if ax * ax + ay * ay + az * az > reach * reach:
                continue
            for place in range(pixel.shape[1]):
                i = pixel[tile, place]
                if i < 0:
                    continue
                dx, dy, dz = y[0] - position[i, 0], y[1] - position[i, 1], y[2] - position[i, 2]
                r2 = dx * dx + dy * dy + dz * dz
                if r2 > radius * radius or r2 <= SAFE_R2:
                    continue
                work[tile, 0] += 1
                cx = normal[i, 0] * dx + normal[i, 1] * dy + normal[i, 2] * dz
                cy = -(y[3] * dx + y[4] * dy + y[5] * dz)
                if cx <= 0 or cy <= 0:
                    continue
                work[tile, 1] += 1
                g = cx * cy / (r2 * max(eps_b, r2))
                for c in range(3):
                    weight[c] = g * y[6 + c]
                reflect(pixels, i, (dx, dy, dz), r2, weight, out)
