"""numba kernel that splats virtual lights with bounded supports on tiles of Lambertian pixels: `splat_kernels` without shadow rays.

Lights that may reach a block of tiles are collected, rows side by side; then, of those, the ones that may reach a tile; each pixel
of the tile adds them up in vector lanes. A collected light costs 64 pixels' sums, so collecting (some 20 operations) is cheap.

A pixel adds its lights in their order, float32 up to LIST of them, float64 beyond; only blocks are spread over threads: the same
bytes at any thread count. `fastmath` leaves the order of a sum's vector lanes to the compiled code, where it is fixed.

The compiler vectorises these loops since all rows of a collection lie in one flat array a constant distance apart: then it needs
few checks that arrays don't overlap.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.cuts import HAT, PARAMETERS, RIDGE, ROULETTE, TWO_HATS
from renderers.transport.kernels import ONE, SAFE_R2, ZERO
from renderers.transport.supports import INNER, OUTER, SHAPE, bound_at, hat, inverse_root, misses, ridge, roulette
from renderers.transport.tiles import AREA

ROWS = 9 + PARAMETERS
SHAPES = (4, 10, 3, 2)  # numbers that the shape of a support takes, by family
PART = 8192  # lights collected for a block at a time
CHUNK = 512  # lights tested against a tile at a time
LIST = 1536  # lights collected for a tile at most
LANES = 32  # lists are filled up to a multiple, so that no light is left to a scalar loop


def packed(lights: np.ndarray) -> np.ndarray:
    """Lights (ROWS, L) in parts of PART, each with its rows in one flat array: float32 (parts, ROWS · PART)."""
    parts = -(-lights.shape[1] // PART)
    whole = np.zeros((ROWS, parts * PART), np.float32)
    whole[:, : lights.shape[1]] = lights
    return np.ascontiguousarray(whole.reshape(ROWS, parts, PART).transpose(1, 0, 2)).reshape(parts, ROWS * PART)


@numba.njit(fastmath=True, error_model="numpy")
def _reaching(bound, rows, start, count, keep, index):  # type: ignore[no-untyped-def]
    """index[:n] = which of the lights start … start + count - 1 of a part may reach a bound; returns n."""
    q = rows[start:]
    for j in range(count):
        out = misses(
            bound, q[j], q[PART + j], q[2 * PART + j], q[3 * PART + j], q[4 * PART + j], q[5 * PART + j],
            q[INNER * PART + j], q[OUTER * PART + j],
        )  # fmt: skip
        keep[j] = np.int32(0) if out else np.int32(1)
    n = 0
    for j in range(count):
        index[n] = start + j
        n += keep[j]
    return n


@numba.njit
def _collect(source, row, index, n, target):  # type: ignore[no-untyped-def]
    """target[:n] = row of the lights index[:n] of a part."""
    values = source[row * PART : (row + 1) * PART]
    for k in range(n):
        target[k] = values[index[k]]


@numba.njit(inline="always")
def _weighted(family, cube, c, q, j):  # type: ignore[no-untyped-def]
    """c · s(α) of collected light j."""
    s = SHAPE - 2
    if family == HAT:
        return hat(cube, c, q[s, j], q[s + 1, j], q[s + 2, j], q[s + 3, j])
    if family == TWO_HATS:
        first = hat(cube, c, q[s, j], q[s + 1, j], q[s + 2, j], q[s + 3, j])
        return first * q[s + 8, j] + hat(cube, c, q[s + 4, j], q[s + 5, j], q[s + 6, j], q[s + 7, j]) * q[s + 9, j]
    if family == RIDGE:
        return ridge(cube, c, q[s, j], q[s + 1, j], q[s + 2, j])
    return roulette(cube, c, q[s, j], q[s + 1, j])


@numba.njit(inline="always")
def _add(family, here, q, count, inverse_bound, sums):  # type: ignore[no-untyped-def]
    """Add the first `count` collected lights, a multiple of LANES, to a tile's pixels; returns how many pairs are lit."""
    hits = 0
    for i in range(AREA):
        px, py, pz, nx, ny, nz = here[0, i], here[1, i], here[2, i], here[3, i], here[4, i], here[5, i]
        sr = sg = sb = lit = ZERO
        for j in range(count):
            vx, vy, vz = q[0, j] - px, q[1, j] - py, q[2, j] - pz
            r2 = vx * vx + vy * vy + vz * vz
            cx = max(ZERO, nx * vx + ny * vy + nz * vz)
            cy = max(ZERO, -(q[3, j] * vx + q[4, j] * vy + q[5, j] * vz))
            safe = max(r2, SAFE_R2)
            inverse = inverse_root(safe)
            square = inverse * inverse
            g = cx * _weighted(family, safe * safe * inverse, cy, q, j) * square * min(inverse_bound, square)
            g = g if r2 > SAFE_R2 else ZERO
            sr += g * q[6, j]
            sg += g * q[7, j]
            sb += g * q[8, j]
            lit += ONE if g > ZERO else ZERO
        sums[0, i] += sr
        sums[1, i] += sg
        sums[2, i] += sb
        hits += int(lit)
    return hits


@numba.njit(fastmath=True, error_model="numpy")
def _flush(family, here, q, n, inverse_bound, sums):  # type: ignore[no-untyped-def]
    """`_add` with each family compiled on its own, after filling up with lights that bring nothing (no normal, no light)."""
    count = (n + LANES - 1) // LANES * LANES
    q[3:9, n:count] = ZERO
    if family == HAT:
        return _add(HAT, here, q, count, inverse_bound, sums)
    if family == TWO_HATS:
        return _add(TWO_HATS, here, q, count, inverse_bound, sums)
    if family == RIDGE:
        return _add(RIDGE, here, q, count, inverse_bound, sums)
    return _add(ROULETTE, here, q, count, inverse_bound, sums)


@numba.njit(parallel=True, fastmath=True, error_model="numpy", cache=True)
def splat_lambert(family, receivers, first, tile_bounds, block_bounds, lights, total, eps_b, out, work):  # type: ignore[no-untyped-def]
    """out (T, 3, AREA) float64 += Σ w G_b I; work (B, 2) int64: pairs evaluated and pairs lit. The caller multiplies by ρ/π.

    lights: `packed`, total of them.
    """
    inverse_bound = ONE / max(eps_b, SAFE_R2)
    shape = SHAPES[family]
    for b in numba.prange(len(first) - 1):
        near = np.empty(ROWS * PART, np.float32)
        q = np.zeros((9 + shape, LIST), np.float32)
        keep, index = np.empty(PART, np.int32), np.empty(PART, np.int32)
        tested, touched = 0, 0
        for p in range(len(lights)):
            n = _reaching(bound_at(block_bounds, b), lights[p], 0, min(PART, total - p * PART), keep, index)
            for row in range(ROWS):
                _collect(lights[p], row, index, n, near[row * PART :])
            for t in range(first[b], first[b + 1]):
                bound, m = bound_at(tile_bounds, t), 0
                for start in range(0, n, CHUNK):
                    k = _reaching(bound, near, start, min(CHUNK, n - start), keep, index)
                    for row in range(9):
                        _collect(near, row, index, k, q[row, m:])
                    for row in range(shape):
                        _collect(near, SHAPE + row, index, k, q[9 + row, m:])
                    m += k
                    if m > LIST - CHUNK or start + CHUNK >= n:
                        tested += m * AREA
                        touched += _flush(family, receivers[t], q, m, inverse_bound, out[t])
                        m = 0
        work[b, 0], work[b, 1] = tested, touched
