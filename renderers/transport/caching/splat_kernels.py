"""numba kernels that add records to the pixels inside their zones, tile by tile. Generic in the float type of the arrays.

A record skips a block of tiles, and then a tile, when even the nearest position and the most similar normal within their balls give
an error above a. A pixel adds its records in their order and only blocks are spread over threads: the same bytes at any thread count.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.caching.weights import weight_scalar

HALF = 1 / np.sqrt(2)


@numba.njit(inline="always")
def misses(ball, position, normal, radius, a):  # type: ignore[no-untyped-def]
    """Whether no point of a ball (8,), of positions and normals, lies in a record's zone. Written for the widest zone (`tent`)."""
    apart = np.sqrt((ball[0] - position[0]) ** 2 + (ball[1] - position[1]) ** 2 + (ball[2] - position[2]) ** 2) - ball[3]
    if apart > a * radius:
        return True
    bend = np.sqrt((ball[4] - normal[0]) ** 2 + (ball[5] - normal[1]) ** 2 + (ball[6] - normal[2]) ** 2) - ball[7]
    return bend * HALF > a


@numba.njit(inline="always")
def weight_at(kind, p, n, position, normal, radius, a):  # type: ignore[no-untyped-def]
    """Weight of a record at a point."""
    dx, dy, dz = p[0] - position[0], p[1] - position[1], p[2] - position[2]
    reach = a * radius
    square = dx * dx + dy * dy + dz * dz
    if square > reach * reach:
        return 0.0
    bx, by, bz = n[0] - normal[0], n[1] - normal[1], n[2] - normal[2]
    return weight_scalar(kind, np.sqrt(square) / radius, np.sqrt(bx * bx + by * by + bz * bz) * HALF, a)


@numba.njit(inline="always")
def extrapolated(c, p, n, position, normal, irradiance, translation, rotation):  # type: ignore[no-untyped-def]
    """E of channel c at a point: max(0, E + (n_k × n)·∇_rE + (p - p_k)·∇_tE)."""
    value = irradiance[c]
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        value += (normal[y] * n[z] - normal[z] * n[y]) * rotation[c, x] + (p[x] - position[x]) * translation[c, x]
    return max(value, 0.0)


@numba.njit(parallel=True, cache=True)
def splat_records(points, normals, pixel, first, tile_balls, block_balls, position, normal, radius, irradiance, translation, rotation, a, kind, gradients, sums, work):  # type: ignore[no-untyped-def]
    """sums (P, 4) += (w·E', w); work (B, 2) int64: pairs of record and pixel tested, and found inside a zone."""
    for b in numba.prange(len(first) - 1):
        tested, touched = 0, 0
        for k in range(len(position)):
            if misses(block_balls[b], position[k], normal[k], radius[k], a):
                continue
            for t in range(first[b], first[b + 1]):
                if misses(tile_balls[t], position[k], normal[k], radius[k], a):
                    continue
                for i in pixel[t]:
                    if i < 0:
                        continue
                    tested += 1
                    p, n = points[i], normals[i]
                    w = weight_at(kind, p, n, position[k], normal[k], radius[k], a)
                    if w <= 0:
                        continue
                    touched += 1
                    sums[i, 3] += w
                    for c in range(3):
                        e = irradiance[k, c]
                        if gradients:
                            e = extrapolated(c, p, n, position[k], normal[k], irradiance[k], translation[k], rotation[k])
                        sums[i, c] += w * e
        work[b, 0], work[b, 1] = tested, touched


@numba.njit(nogil=True, cache=True)
def accept(points, normals, pixel, first, tile_balls, block_balls, candidates, radius, a, kind, covered, limit, accepted):  # type: ignore[no-untyped-def]
    """Walk candidates (pixel indices) in order; each that isn't covered is accepted, and covers its zone. Returns how many are."""
    count = 0
    for place in range(len(candidates)):
        at = candidates[place]
        if covered[at]:
            continue
        if count == limit:
            break
        accepted[count] = at
        count += 1
        covered[at] = True
        for b in range(len(first) - 1):
            if misses(block_balls[b], points[at], normals[at], radius[place], a):
                continue
            for t in range(first[b], first[b + 1]):
                if misses(tile_balls[t], points[at], normals[at], radius[place], a):
                    continue
                for i in pixel[t]:
                    if i >= 0 and not covered[i]:
                        w = weight_at(kind, points[i], normals[i], points[at], normals[at], radius[place], a)
                        covered[i] = w > 0
    return count


@numba.njit(parallel=True, cache=True)
def gather_records(points, normals, position, normal, radius, irradiance, translation, rotation, a, kind, gradients, sums):  # type: ignore[no-untyped-def]
    """sums (P, 4) += (w·E', w) over all records, point by point: what a splat is compared with."""
    for i in numba.prange(len(points)):
        p, n = points[i], normals[i]
        for k in range(len(position)):
            w = weight_at(kind, p, n, position[k], normal[k], radius[k], a)
            if w > 0:
                sums[i, 3] += w
                for c in range(3):
                    e = irradiance[k, c]
                    if gradients:
                        e = extrapolated(c, p, n, position[k], normal[k], irradiance[k], translation[k], rotation[k])
                    sums[i, c] += w * e
