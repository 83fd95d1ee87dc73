"""Hits drawn into polar hemispheres, against the same said plainly: far to near, point by point, hole by hole."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.transport.caching.hemisphere import Grid
from renderers.transport.temporal.reprojection import Moved, reprojected

F64 = NDArray[np.float64]
GRID = Grid(10, 32)
AXIS = np.array([np.sin(1.0), 0.0, np.cos(1.0)])  # of what moves: across the seam of azimuths, 33° above the horizon


def towards(ring: Any, sector: Any, solid: bool) -> F64:
    """Unit directions of places in the grid, in cells."""
    share = np.asarray(ring, np.float64) / GRID.rings
    height = 1 - share if solid else np.sqrt(1 - share)
    sine, phi = np.sqrt(1 - height**2), 2 * np.pi * np.asarray(sector, np.float64) / GRID.sectors
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), height], axis=-1)


def hemisphere(solid: bool) -> tuple[F64, F64, NDArray[np.bool_]]:
    """Jittered directions (R, 3) of a hemisphere's cells, distances (R,), and what moves: a disc 1 away; the rest is 2.5 to 3."""
    rng = np.random.default_rng(4)
    row, column = np.divmod(np.arange(GRID.cells), GRID.sectors)
    direction = towards(row + rng.uniform(0.1, 0.9, GRID.cells), column + rng.uniform(0.1, 0.9, GRID.cells), solid)
    moves = direction @ AXIS > np.cos(0.45)
    return direction, np.where(moves, rng.uniform(0.9, 1.1, GRID.cells), rng.uniform(2.5, 3.0, GRID.cells)), moves


def points_of(cell: int, hit: F64, shift: F64, facing: F64, f: int, solid: bool) -> F64:
    """Where a moving hit is drawn, (F², 3): itself, or parts of its cell on its tangent plane, half to twice as far."""
    if f == 1:
        return (hit + shift)[None]
    row, column = divmod(cell, GRID.sectors)
    part = (np.arange(f) + 0.5) / f
    rays = towards(*(x.ravel() for x in np.meshgrid(row + part, column + part, indexing="ij")), solid)
    reach = np.linalg.norm(hit)
    with np.errstate(divide="ignore"):
        along = (hit @ facing) / (rays @ facing)
    along = np.where((along < reach / 2) | (along > 2 * reach), reach, along)
    return rays * along[:, None] + shift


def plainly(
    direction: F64, distance: F64, moves: NDArray[np.bool_], shift: F64, facing: F64, f: int, solid: bool
) -> tuple[F64, F64]:
    """Source (R·f, S·f) and depth after the motion."""
    shape = GRID.rings * f, GRID.sectors * f
    source, depth = np.full(shape, -1), np.full(shape, np.inf)
    drawn = []
    for cell in range(GRID.cells):
        row, column = divmod(cell, GRID.sectors)
        if not moves[cell]:
            block = slice(row * f, row * f + f), slice(column * f, column * f + f)
            source[block], depth[block] = cell, distance[cell]
        else:
            drawn += [(p, cell) for p in points_of(cell, direction[cell] * distance[cell], shift, facing, f, solid) if p[2] > 1e-6]
    for p, cell in sorted(drawn, key=lambda point: -np.linalg.norm(point[0])):
        far = np.linalg.norm(p)
        height = p[2] / far
        j = int((1 - height if solid else 1 - height**2) * shape[0])
        k = int(np.arctan2(p[1], p[0]) % (2 * np.pi) / (2 * np.pi) * shape[1]) % shape[1]
        if far < depth[j, k]:
            source[j, k], depth[j, k] = cell, far
    while (source < 0).any():
        known, deep = source.copy(), depth.copy()
        for j, k in np.argwhere(known < 0):
            near = [(a, b % shape[1]) for a in (j - 1, j, j + 1) for b in (k - 1, k, k + 1) if 0 <= a < shape[0]]
            near = [cell for cell in near if known[cell] >= 0]
            if near:
                best = max(near, key=lambda cell: deep[cell])
                source[j, k], depth[j, k] = known[best], deep[best]
    return source, depth


@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.parametrize("f", [1, 4])
@pytest.mark.parametrize("shift", [(-0.3, 0.25, 0.1), (0.2, -0.1, -0.45), (0.6, 0.0, 0.3)])
def test_moved_hits_are_drawn_as_said(shift: tuple[float, float, float], f: int, solid: bool) -> None:
    """Nearer, below the horizon, away. At most 1 % of the cells differ (float32, where a point lands on a border)."""
    direction, distance, moves = hemisphere(solid)
    facing = np.array([-0.6, 0.64, -0.48])  # a slanted disc: some of its tangent plane is far off
    radiance = np.random.default_rng(5).uniform(0, 1, (GRID.cells, 3)).astype(np.float32)
    cast: Any = SimpleNamespace(
        sites=SimpleNamespace(normal=np.array([[0.0, 0, 1]])),
        tangents=np.eye(3)[None, :2],
        origins=np.zeros((GRID.cells, 3), np.float32),
        found=SimpleNamespace(nearness=(1 / distance).astype(np.float32)),
    )
    hits, ray = direction * distance[:, None], np.arange(GRID.cells)
    moved = Moved(ray, hits, hits + np.where(moves[:, None], shift, 0), np.tile(facing, (GRID.cells, 1)), moves)
    light, near = reprojected(cast, moved, radiance, GRID, f, solid)
    source, depth = plainly(direction, distance, moves, np.array(shift), facing, f, solid)
    parts = GRID.rings, f, GRID.sectors, f
    expected = radiance[source].reshape(*parts, 3).mean(axis=(1, 3)).reshape(-1, 3)
    nearness = (1 / depth).reshape(parts).mean(axis=(1, 3)).ravel()
    off = (np.abs(light - expected).max(axis=1) > 1e-5) | (np.abs(near - nearness) > 1e-5 * nearness)
    assert off.mean() <= 0.01
    assert (np.abs(expected - radiance).max(axis=1) > 1e-5).mean() > 0.05
