"""Covered pixels in square screen tiles, with balls around them, so that light which can't reach a tile is passed over at once.

Bounds are taken in the World, from what the pixels hold, not by projecting lights: a light behind the camera, around it or off the
screen needs no special case. 4 × 4 tiles form a block, which has a ball of its own.
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
    normal 0, hence receive nothing. first int32 (B+1,): block b owns tiles first[b] … first[b+1]-1. tile_balls float32 (T, 8),
    block_balls (B, 8): see `balls`.
    """

    pixel: NDArray[np.int32]
    receivers: F32
    first: NDArray[np.int32]
    tile_balls: F32
    block_balls: F32


def tiles_of(rows: NDArray[np.intp], width: int, position: F32, normal: F32) -> Tiles:
    """Tiles of covered pixels: rows (P,) flat pixel indices in an image `width` wide, position and normal (P, 3)."""
    y, x = np.divmod(rows, width)
    tile_y, tile_x = y // SIDE, x // SIDE
    across = -(-width // (SIDE * BLOCK)) + 1
    block = (tile_y // BLOCK) * across + tile_x // BLOCK
    key = (block * BLOCK + tile_y % BLOCK) * BLOCK + tile_x % BLOCK
    keys, tile = np.unique(key, return_inverse=True)
    pixel = np.full((len(keys), AREA), -1, np.int32)
    pixel[tile, (y % SIDE) * SIDE + x % SIDE] = np.arange(len(rows))
    filled = pixel >= 0
    # Empty places repeat a pixel of their tile, so that balls stay tight.
    some = pixel[np.arange(len(keys)), filled.argmax(axis=1)]
    source = np.where(filled, pixel, some[:, None])
    receivers = np.empty((len(keys), 6, AREA), np.float32)
    receivers[:, :3] = position[source].transpose(0, 2, 1)
    normals = normal[source].transpose(0, 2, 1)
    receivers[:, 3:] = normals * filled[:, None, :]
    owner = keys // BLOCK**2
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    tile_balls = balls(receivers[:, :3], normals)
    first = np.append(first, len(keys))
    block_balls = np.zeros((len(first) - 1, 8), np.float32)
    for b in range(len(block_balls)):
        block_balls[b] = _merged(tile_balls[first[b] : first[b + 1]])
    return Tiles(pixel, receivers, first.astype(np.int32), tile_balls, block_balls)


def balls(position: F32, normal: F32) -> F32:
    """Balls around positions (T, 3, n) and around normals (T, 3, n): centre and radius, twice, float32 (T, 8)."""

    def ball(points: F32) -> NDArray[np.float64]:
        wide = points.astype(np.float64)
        centre = (wide.min(axis=2) + wide.max(axis=2)) / 2
        radius = np.linalg.norm(wide - centre[:, :, None], axis=1).max(axis=1)
        # The kernels compare in float32: radii grow by the rounding of sizes up to 1.
        return np.concatenate([centre, radius[:, None] + ROUNDING], axis=1)

    return np.concatenate([ball(position), ball(normal)], axis=1).astype(np.float32)


def _merged(parts: F32) -> F32:
    """One ball around several, (8,)."""
    out = np.empty(8, np.float32)
    for at in (0, 4):
        low = (parts[:, at : at + 3] - parts[:, at + 3 : at + 4]).min(axis=0)
        high = (parts[:, at : at + 3] + parts[:, at + 3 : at + 4]).max(axis=0)
        centre = (low + high) / 2
        out[at : at + 3] = centre
        out[at + 3] = (np.linalg.norm(parts[:, at : at + 3] - centre, axis=1) + parts[:, at + 3]).max() + ROUNDING
    return out
