"""numba kernel that splats virtual lights with bounded supports on tiles of Lambertian pixels: `splat_kernels` without shadow rays.

Lights that may reach a block of tiles are listed; then, of those, the ones that may reach a tile; each of these is added to the
tile's 64 pixels side by side in vector lanes, so that listing it (some 20 operations) is cheap.

A pixel adds its lights in their order, float32 up to FOLDED of them, float64 beyond; only blocks are spread over threads, and what
is fused is said (`fused`): the same bytes at any thread count, and whatever the compiler makes of it.

The compiler vectorises these loops since all rows of an array lie in one flat piece a constant distance apart: then it needs few
checks that arrays don't overlap.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.cuts import HAT, RIDGE, ROULETTE, TWO_HATS
from renderers.transport.fused import fma
from renderers.transport.kernels import ONE, SAFE_R2, ZERO
from renderers.transport.supports import INNER, OUTER, SHAPE, bound_at, hat, inverse_root, misses, ridge, roulette
from renderers.transport.tiles import AREA

TESTED = (0, 1, 2, 3, 4, 5, INNER, OUTER)  # rows of a light that say where it may act
TESTS = len(TESTED)
PART = 4096  # lights listed at a time
FOLDED = 128  # lights added in float32
ROW = AREA + 16  # of a tile; rows at powers of two would share the sets of the cache


class Packed(NamedTuple):
    """L lights: where they act, in parts of PART with each part's rows in one flat array, float32 (parts, TESTS · PART); and what
    they bring, light by light, float32 (L, 9 + PARAMETERS - 2): position, normal, intensity, shape of the support."""

    tested: NDArray[np.float32]
    rows: NDArray[np.float32]


def packed(lights: NDArray[np.float32]) -> Packed:
    """The rows of `splat.light_rows`, float32 (9 + PARAMETERS, L), as the kernel reads them."""
    count = lights.shape[1]
    parts = -(-count // PART)
    tested = np.zeros((TESTS, parts * PART), np.float32)
    tested[:, :count] = lights[list(TESTED)]
    flat = np.ascontiguousarray(tested.reshape(TESTS, parts, PART).transpose(1, 0, 2)).reshape(parts, TESTS * PART)
    return Packed(flat, np.ascontiguousarray(np.concatenate([lights[:INNER], lights[SHAPE:]]).T))


@numba.njit(error_model="numpy")
def _reaching(bound, q, count, keep, index):  # type: ignore[no-untyped-def]
    """index[:n] = which of a part's first `count` lights may reach a bound; returns n."""
    for j in range(count):
        out = misses(
            bound, q[j], q[PART + j], q[2 * PART + j], q[3 * PART + j], q[4 * PART + j], q[5 * PART + j],
            q[6 * PART + j], q[7 * PART + j],
        )  # fmt: skip
        keep[j] = np.int32(0) if out else np.int32(1)
    n = 0
    for j in range(count):
        index[n] = j
        n += keep[j]
    return n


@numba.njit
def _collect(source, index, n, target):  # type: ignore[no-untyped-def]
    """target = the lights index[:n] of a part."""
    for row in range(TESTS):
        values, chosen = source[row * PART : (row + 1) * PART], target[row * PART : (row + 1) * PART]
        for k in range(n):
            chosen[k] = values[index[k]]


@numba.njit(inline="always")
def _weighted(family, cube, c, s):  # type: ignore[no-untyped-def]
    """c · s(α) of a light whose support has the shape s."""
    if family == HAT:
        return hat(cube, c, s[0], s[1], s[2], s[3])
    if family == TWO_HATS:
        return fma(hat(cube, c, s[0], s[1], s[2], s[3]), s[8], hat(cube, c, s[4], s[5], s[6], s[7]) * s[9])
    if family == RIDGE:
        return ridge(cube, c, s[0], s[1], s[2])
    return roulette(cube, c, s[0], s[1])


@numba.njit(inline="always")
def _add(family, tile, rows, j, inverse_bound):  # type: ignore[no-untyped-def]
    """Add light j of `Packed.rows` to a tile: ten rows of AREA, ROW apart: position, normal, sum, number of lights that lit it."""
    x, y, z = rows[j, 0], rows[j, 1], rows[j, 2]
    a, b, c = -rows[j, 3], -rows[j, 4], -rows[j, 5]
    red, green, blue = rows[j, 6], rows[j, 7], rows[j, 8]
    shape = (
        rows[j, 9], rows[j, 10], rows[j, 11], rows[j, 12], rows[j, 13],
        rows[j, 14], rows[j, 15], rows[j, 16], rows[j, 17], rows[j, 18],
    )  # fmt: skip
    for i in range(AREA):
        vx, vy, vz = x - tile[i], y - tile[ROW + i], z - tile[2 * ROW + i]
        r2 = fma(vx, vx, fma(vy, vy, vz * vz))
        cx = max(ZERO, fma(tile[3 * ROW + i], vx, fma(tile[4 * ROW + i], vy, tile[5 * ROW + i] * vz)))
        cy = max(ZERO, fma(a, vx, fma(b, vy, c * vz)))
        inverse = inverse_root(r2)
        square = inverse * inverse
        g = cx * _weighted(family, r2 * r2 * inverse, cy, shape) * square * min(inverse_bound, square)
        g = g if r2 > SAFE_R2 else ZERO
        tile[6 * ROW + i] = fma(g, red, tile[6 * ROW + i])
        tile[7 * ROW + i] = fma(g, green, tile[7 * ROW + i])
        tile[8 * ROW + i] = fma(g, blue, tile[8 * ROW + i])
        tile[9 * ROW + i] += ONE if g > ZERO else ZERO


@numba.njit
def _fold(tile, out):  # type: ignore[no-untyped-def]
    """out (3, AREA) float64 += a tile's sums, which begin anew; returns how many pairs were lit."""
    for c in range(3):
        part = tile[(6 + c) * ROW : (6 + c) * ROW + AREA]
        for i in range(AREA):
            out[c, i] += part[i]
    lit = 0
    for i in range(AREA):
        lit += int(tile[9 * ROW + i])
    tile[6 * ROW :] = ZERO
    return lit


@numba.njit(inline="always")
def _add_all(family, tile, rows, which, index, n, inverse_bound, out):  # type: ignore[no-untyped-def]
    """out (3, AREA) += light of rows[which[index[:n]]] on a tile; returns how many pairs are lit."""
    lit = 0
    for start in range(0, n, FOLDED):
        for k in range(start, min(start + FOLDED, n)):
            _add(family, tile, rows, which[index[k]], inverse_bound)
        lit += _fold(tile, out)
    return lit


@numba.njit(error_model="numpy")
def _add_lights(family, tile, rows, which, index, n, inverse_bound, out):  # type: ignore[no-untyped-def]
    """`_add_all` with each family compiled on its own."""
    if family == HAT:
        return _add_all(HAT, tile, rows, which, index, n, inverse_bound, out)
    if family == TWO_HATS:
        return _add_all(TWO_HATS, tile, rows, which, index, n, inverse_bound, out)
    if family == RIDGE:
        return _add_all(RIDGE, tile, rows, which, index, n, inverse_bound, out)
    return _add_all(ROULETTE, tile, rows, which, index, n, inverse_bound, out)


@numba.njit(parallel=True, error_model="numpy", cache=True)
def splat_lambert(family, receivers, first, tile_bounds, block_bounds, tested, rows, eps_b, out, work):  # type: ignore[no-untyped-def]
    """out (T, 3, AREA) float64 += Σ w G_b I; work (B, 2) int64: pairs evaluated and pairs lit. The caller multiplies by ρ/π.

    tested, rows: `Packed`.
    """
    inverse_bound = ONE / max(eps_b, SAFE_R2)
    for b in numba.prange(len(first) - 1):
        near, tile = np.empty(TESTS * PART, np.float32), np.zeros(10 * ROW, np.float32)
        keep, block, index = np.empty(PART, np.int32), np.empty(PART, np.int32), np.empty(PART, np.int32)
        evaluated, lit = 0, 0
        for p in range(len(tested)):
            own = rows[p * PART : (p + 1) * PART]
            n = _reaching(bound_at(block_bounds, b), tested[p], len(own), keep, block)
            _collect(tested[p], block, n, near)
            for t in range(first[b], first[b + 1]):
                m = _reaching(bound_at(tile_bounds, t), near, n, keep, index)
                for row in range(6):
                    tile[row * ROW : row * ROW + AREA] = receivers[t, row]
                evaluated += m * AREA
                lit += _add_lights(family, tile, own, block, index, m, inverse_bound, out[t])
        work[b, 0], work[b, 1] = evaluated, lit
