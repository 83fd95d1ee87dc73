"""numba kernels that add records to the pixels inside their zones, tile by tile. Generic in the float type of the arrays.

A record skips a block of tiles, and then a tile, when even the nearest position and the most similar normal within their balls give
an error above a (`tiles_reached`). A pixel adds its records in their order, and only blocks are spread over threads: the same bytes
at any number of threads. points, normals (P, 3): of the pixels; tiles: `tiles.Tiles`; records: `records.Columns`.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.caching.weights import weight

HALF = 1 / np.sqrt(2)


@numba.njit(inline="always")
def misses(ball, position, normal, radius, a):  # type: ignore[no-untyped-def]
    """Whether no point within a bound (balls around positions and normals) lies in a record's zone, the widest one (`tent`)."""
    apart = np.sqrt((ball[0] - position[0]) ** 2 + (ball[1] - position[1]) ** 2 + (ball[2] - position[2]) ** 2) - ball[3]
    if apart > a * radius:
        return True
    bend = np.sqrt((ball[4] - normal[0]) ** 2 + (ball[5] - normal[1]) ** 2 + (ball[6] - normal[2]) ** 2) - ball[7]
    return bend * HALF > a


@numba.njit(nogil=True, cache=True)
def tiles_reached(tiles, first, last, position, normal, radius, a, out):  # type: ignore[no-untyped-def]
    """Tiles of blocks first … last-1 that may hold pixels of a record's zone, in order: the used part of `out` (T,) int64.

    A list, since numba's generators don't inline: the same loop as one made a splat five times slower.
    """
    count = 0
    for b in range(first, last):
        if misses(tiles.block_bounds[b], position, normal, radius, a):
            continue
        for t in range(tiles.first[b], tiles.first[b + 1]):
            if not misses(tiles.tile_bounds[t], position, normal, radius, a):
                out[count] = t
                count += 1
    return out[:count]


@numba.njit(inline="always")
def weight_at(kind, p, n, position, normal, radius, a):  # type: ignore[no-untyped-def]
    """Weight at point p with normal n of a record."""
    dx, dy, dz = p[0] - position[0], p[1] - position[1], p[2] - position[2]
    reach = a * radius
    square = dx * dx + dy * dy + dz * dz
    if square > reach * reach:
        return 0.0
    bx, by, bz = n[0] - normal[0], n[1] - normal[1], n[2] - normal[2]
    return weight(kind, np.sqrt(square) / radius, np.sqrt(bx * bx + by * by + bz * bz) * HALF, a)


@numba.njit(inline="always")
def add(p, n, w, records, k, gradients, sums):  # type: ignore[no-untyped-def]
    """sums (4,) += (w·E', w) with E' = max(0, E + (n_k × n)·∇_rE + (p - p_k)·∇_tE) of record k."""
    sums[3] += w
    for c in range(3):
        value = records.irradiance[k, c]
        if gradients:
            m = records.normal[k]
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                value += (m[y] * n[z] - m[z] * n[y]) * records.rotation[k, c, x]
                value += (p[x] - records.position[k, x]) * records.translation[k, c, x]
            value = max(value, 0.0)
        sums[c] += w * value


@numba.njit(parallel=True, cache=True)
def splat_records(points, normals, tiles, records, a, kind, gradients, sums, work):  # type: ignore[no-untyped-def]
    """sums (P, 4) += (w·E', w); work (B, 2) int64: pairs of record and pixel tested, and found inside a zone."""
    for b in numba.prange(len(tiles.first) - 1):
        tested, touched = 0, 0
        reached = np.empty(tiles.first[b + 1] - tiles.first[b], np.int64)
        for k in range(len(records.position)):
            position, normal, radius = records.position[k], records.normal[k], records.radius[k]
            for t in tiles_reached(tiles, b, b + 1, position, normal, radius, a, reached):
                for i in tiles.pixel[t]:
                    if i < 0:
                        continue
                    tested += 1
                    w = weight_at(kind, points[i], normals[i], position, normal, radius, a)
                    if w > 0:
                        touched += 1
                        add(points[i], normals[i], w, records, k, gradients, sums[i])
        work[b, 0], work[b, 1] = tested, touched


@numba.njit(nogil=True, cache=True)
def accept(points, normals, tiles, candidates, radius, a, kind, covered, accepted, few, left):  # type: ignore[no-untyped-def]
    """Walk candidates (pixels) in order; each that isn't covered is accepted and covers its zone, until `accepted` is full.

    radius: of each candidate. Returns how many are accepted. Where a zone would cover fewer pixels than `few` (P,) at the
    candidate, these are covered and `left` (P,) instead, and the candidate isn't accepted.
    """
    count, reached = 0, np.empty(len(tiles.pixel), np.int64)
    newly = np.empty(len(points), np.int64)
    for place in range(len(candidates)):
        at = candidates[place]
        if count == len(accepted):
            break
        if not covered[at]:
            covered[at] = True
            newly[0] = at
            size = _cover(points, normals, tiles, points[at], normals[at], radius[place], a, kind, reached, covered, newly)
            if size < few[at]:
                left[newly[:size]] = True
            else:
                accepted[count] = at
                count += 1
    return count


@numba.njit(nogil=True, cache=True)
def _cover(points, normals, tiles, position, normal, radius, a, kind, reached, covered, newly):  # type: ignore[no-untyped-def]
    """Cover a zone. newly: pixels that are covered by it; the first stands there already. Returns how many."""
    size = 1
    for t in tiles_reached(tiles, 0, len(tiles.first) - 1, position, normal, radius, a, reached):
        for i in tiles.pixel[t]:
            if i >= 0 and not covered[i] and weight_at(kind, points[i], normals[i], position, normal, radius, a) > 0:
                covered[i] = True
                newly[size] = i
                size += 1
    return size


@numba.njit(parallel=True, cache=True)
def gather_records(points, normals, records, a, kind, gradients, sums):  # type: ignore[no-untyped-def]
    """sums (P, 4) += (w·E', w) over all records, point by point: what a splat is compared with."""
    for i in numba.prange(len(points)):
        for k in range(len(records.position)):
            w = weight_at(kind, points[i], normals[i], records.position[k], records.normal[k], records.radius[k], a)
            if w > 0:
                add(points[i], normals[i], w, records, k, gradients, sums[i])
