"""Covered pixels in square screen tiles, with bounds around them, so that light which can't reach a tile is passed over at once.

Bounds are taken in the World, from what the pixels hold, not by projecting lights: a light behind the camera, around it or off the
screen needs no special case. 4 × 4 tiles form a block, which has a bound of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
SIDE = 8
AREA = SIDE * SIDE
BLOCK = 4
ROUNDING = 1e-5


class Tiles(NamedTuple):
    """T tiles of AREA pixels, those of one block next to each other, B blocks.

    pixel int32 (T, AREA): index of a covered pixel, or -1. receivers float32 (T, 6, AREA): position and normal; empty places have
    normal 0, hence receive nothing. first int32 (B+1,): block b owns tiles first[b] … first[b+1]-1. tile_bounds float32 (T, 9),
    block_bounds (B, 9): see `bounds_of`.
    """

    pixel: NDArray[np.int32]
    receivers: F32
    first: NDArray[np.int32]
    tile_bounds: F32
    block_bounds: F32


def tiles_of(rows: NDArray[np.intp], width: int, position: F32, normal: F32) -> Tiles:
    """Tiles of covered pixels: rows (P,) flat pixel indices in an image `width` wide, position and normal (P, 3)."""
    y, x = np.divmod(rows, width)
    tile_y, tile_x = y // SIDE, x // SIDE
    across = -(-width // (SIDE * BLOCK)) + 1
    block = (tile_y // BLOCK) * across + tile_x // BLOCK
    key = (block * BLOCK + tile_y % BLOCK) * BLOCK + tile_x % BLOCK
    present = np.zeros(int(key.max(initial=-1)) + 1, np.bool_)
    present[key] = True
    keys = np.flatnonzero(present)
    pixel = np.full((len(keys), AREA), -1, np.int32)
    pixel[np.cumsum(present)[key] - 1, (y % SIDE) * SIDE + x % SIDE] = np.arange(len(rows))
    filled = pixel >= 0
    # Empty places repeat a pixel of their tile, so that balls stay tight.
    some = pixel[np.arange(len(keys)), filled.argmax(axis=1)]
    source = np.where(filled, pixel, some[:, None])
    receivers = np.empty((len(keys), 6, AREA), np.float32)
    receivers[:, :3] = position[source].transpose(0, 2, 1)
    normals = np.ascontiguousarray(normal[source].transpose(0, 2, 1))
    receivers[:, 3:] = normals * filled[:, None, :]
    owner = keys // BLOCK**2
    first = np.append(np.flatnonzero(np.diff(owner, prepend=-1)), len(keys))
    positions = receivers[:, :3]
    return Tiles(
        pixel,
        receivers,
        first.astype(np.int32),
        bounds_of(positions, normals, np.arange(len(keys) + 1)),
        bounds_of(positions, normals, first),
    )


def bounds_of(position: F32, normal: F32, first: NDArray[np.integer]) -> F32:
    """Bounds of groups of tiles, float32 (G, 9): centre and radius of a ball around positions, centre and spread of one around
    normals, and the least component of a position along that centre, below which no receiver lies.

    position, normal (T, 3, n); group g owns tiles first[g] … first[g+1]-1. So light at y stands at most
    centre of n · y - floor + spread · |y - x| above the plane of any receiver x: exact where the group is flat.
    """
    if len(position) == 0:
        return np.zeros((0, 9), np.float32)
    start, group = first[:-1], np.repeat(np.arange(len(first) - 1), np.diff(first))

    def ball(points: F32) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        low = np.minimum.reduceat(points.min(axis=2), start).astype(np.float64)
        high = np.maximum.reduceat(points.max(axis=2), start)
        centre = (low + high) / 2
        off = points - centre.astype(np.float32)[group][:, :, None]
        return centre, np.sqrt(np.maximum.reduceat((off * off).sum(axis=1).max(axis=1), start).astype(np.float64))

    centre, radius = ball(position)
    facing, spread = ball(normal)
    floor = np.minimum.reduceat((facing[group][:, :, None] * position).sum(axis=1).min(axis=1), start)
    # The kernels compare in float32: radii grow by the rounding of sizes up to 1.
    return np.concatenate([centre, radius[:, None] + ROUNDING, facing, spread[:, None], floor[:, None]], axis=1).astype(np.float32)
