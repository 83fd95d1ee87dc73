"""How many pairs (virtual light, pixel) face one another: those to which instant radiosity gives more than 0."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer

TILE = 256


def count_facing(gbuffer: GBuffer, positions: NDArray[np.float32], normals: NDArray[np.float32]) -> int:
    """Pairs of a covered pixel and a light with ⟨n_x, y - x⟩ > 0 and ⟨n_y, x - y⟩ > 0. positions, normals: float32 (L, 3)."""
    seen = gbuffer.covered
    lights = np.ascontiguousarray(np.concatenate([positions, normals], axis=1).T, np.float32)
    return int(_count(np.ascontiguousarray(gbuffer.position[seen]), np.ascontiguousarray(gbuffer.normal[seen]), lights))


@numba.njit(parallel=True, cache=True)
def _count(position, normal, lights):  # type: ignore[no-untyped-def]
    pixels, total = len(position), lights.shape[1]
    tiles = (pixels + TILE - 1) // TILE
    found = np.zeros(tiles, np.int64)
    x, y, z = lights[0], lights[1], lights[2]
    a, b, c = lights[3], lights[4], lights[5]
    for tile in numba.prange(tiles):
        for i in range(tile * TILE, min(tile * TILE + TILE, pixels)):
            px, py, pz = position[i, 0], position[i, 1], position[i, 2]
            nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
            facing = 0
            for j in range(total):
                vx, vy, vz = x[j] - px, y[j] - py, z[j] - pz
                before = nx * vx + ny * vy + nz * vz > 0
                ahead = a[j] * vx + b[j] * vy + c[j] * vz < 0
                facing += before & ahead
            found[tile] += facing
    return found.sum()
