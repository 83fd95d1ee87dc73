"""Temporal accumulation: each pixel's past value is looked up where its surface point was one frame ago, and averaged with the new.

    mean_t(p) = (1 - α) mean_{t-1}(p') + α L_t(p),   α = max(1/n, α_min), n: frames that the pixel has been followed for

The surface point moves with its triangle, known exactly in both frames. Of the four pixels around p' those count that saw the same
surface: the same instance, nearly the same normal, and a plane through the point. Where none did, the past is forgotten.
Source: the reprojection cache of Nehab et al. 2007, exponential average as in temporal antialiasing (Karis 2014).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World

F64 = NDArray[np.float64]
ALIKE = 0.9  # cosine between normals of one surface
PLANE = 0.01  # distance from the plane through the point, over the distance from the eye


class History(NamedTuple):
    """A frame and what has been averaged up to it: mean float64 (H, W, 3), age float64 (H, W) in frames."""

    world: World
    gbuffer: GBuffer
    mean: F64
    age: F64


def accumulated(new: NDArray[np.float32], world: World, gbuffer: GBuffer, past: History | None, least: float) -> History:
    """A new frame (H, W, 3) averaged with its past. least: α_min in (0, 1]; 1 keeps nothing."""
    fresh = new.astype(np.float64)
    if past is None or len(past.world.triangles) != len(world.triangles):
        return History(world, gbuffer, fresh, gbuffer.covered.astype(np.float64))
    mean, age = np.zeros_like(fresh), np.zeros(gbuffer.triangle.shape)
    rows = np.flatnonzero(gbuffer.covered)
    mean.reshape(-1, 3)[rows], age.ravel()[rows] = _past(world, gbuffer, past, rows)
    alpha = np.where(age > 0, np.maximum(1 / (age + 1), least), 1.0)[..., None]
    return History(world, gbuffer, (1 - alpha) * mean + alpha * fresh, np.where(gbuffer.covered, age + 1, 0))


def _past(world: World, gbuffer: GBuffer, past: History, rows: NDArray[np.intp]) -> tuple[F64, F64]:
    """Mean (P, 3) and age (P,) one frame ago of pixels (flat indices), age 0 where there is none."""
    triangle = gbuffer.triangle.ravel()[rows]
    point, normal = _before(world, past.world, triangle, gbuffer.position.reshape(-1, 3)[rows].astype(np.float64))
    height, width = past.mean.shape[:2]
    camera = past.world.camera
    local = (point - camera.pose[:3, 3]) @ camera.pose[:3, :3]
    depth = -local[:, 2]
    scale = height / (2 * np.tan(camera.yfov / 2)) / np.where(depth > 0, depth, np.inf)
    x, y = width / 2 + local[:, 0] * scale - past.gbuffer.offset[0], height / 2 - local[:, 1] * scale - past.gbuffer.offset[1]
    column, row = np.floor(x + 1e-4), np.floor(y + 1e-4)
    mean, age, total = np.zeros((len(rows), 3)), np.zeros(len(rows)), np.zeros(len(rows))
    for dy in (0, 1):
        for dx in (0, 1):
            i, j = (row + dy).astype(np.int64), (column + dx).astype(np.int64)
            share = np.clip(1 - np.abs(x - j), 0, 1) * np.clip(1 - np.abs(y - i), 0, 1)
            inside = (depth > 0) & (i >= 0) & (i < height) & (j >= 0) & (j < width)
            i, j = np.where(inside, i, 0), np.where(inside, j, 0)
            seen = past.gbuffer.triangle[i, j]
            same = inside & (seen >= 0) & (past.world.instance[seen] == world.instance[triangle])
            same &= np.abs(np.einsum("nc,nc->n", past.world.normals_of(np.maximum(seen, 0)), normal)) >= ALIKE
            off = np.einsum("nc,nc->n", past.gbuffer.position[i, j] - point, normal)
            same &= np.abs(off) <= PLANE * np.maximum(depth, 0)
            share = np.where(same, share, 0)
            mean += share[:, None] * past.mean[i, j]
            age += share * past.age[i, j]
            total += share
    known = total > 1e-3
    divisor = np.where(known, total, 1)
    return np.where(known[:, None], mean / divisor[:, None], 0), np.where(known, age / divisor, 0)


def _before(now: World, then: World, triangle: NDArray[np.int32], point: F64) -> tuple[F64, F64]:
    """Where points (N, 3) of triangles were in an earlier World, and the unit geometric normals there (N, 3)."""
    a, b, c = (now.positions[column].astype(np.float64) for column in now.triangles[triangle].T)
    e, f, d = b - a, c - a, point - a
    ee, ef, ff = (np.einsum("nc,nc->n", p, q) for p, q in ((e, e), (e, f), (f, f)))
    de, df = (np.einsum("nc,nc->n", d, q) for q in (e, f))
    det = np.maximum(ee * ff - ef * ef, 1e-300)
    u, v = ((ff * de - ef * df) / det)[:, None], ((ee * df - ef * de) / det)[:, None]
    a, b, c = (then.positions[column].astype(np.float64) for column in then.triangles[triangle].T)
    return a + u * (b - a) + v * (c - a), then.normals_of(triangle)
