"""The decision of every triangle, and of every part of a large one. float32 throughout, in the order of the shaders.

`ratio` is a triangle's area over the area of one point: up to 1 it is the probability to be kept, above it the triangle is cut up.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.resampling.numbers import number, placed
from renderers.transport.resampling.pattern import MOST, level

DROPPED, KEPT, LARGE = 0, 1, 2
FULL = np.float32(2.0**32)


@numba.njit(cache=True)
def ratio_of(positions, corners, inverse):  # type: ignore[no-untyped-def]
    """Area of a triangle over the area of one point, whose inverse is given."""
    a, b, c = corners[0], corners[1], corners[2]
    x1, y1, z1 = positions[b, 0] - positions[a, 0], positions[b, 1] - positions[a, 1], positions[b, 2] - positions[a, 2]
    x2, y2, z2 = positions[c, 0] - positions[a, 0], positions[c, 1] - positions[a, 1], positions[c, 2] - positions[a, 2]
    x, y, z = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
    return np.float32(0.5) * np.sqrt(x * x + y * y + z * z) * inverse


@numba.njit(cache=True)
def kept(value, chance):  # type: ignore[no-untyped-def]
    """Whether a point of that number is kept with that probability; compared as integers, so that small ones keep their digits."""
    return chance >= np.float32(1) or value < np.uint64(chance * FULL)


@numba.njit(cache=True)
def of_corners(corners, key):  # type: ignore[no-untyped-def]
    """A triangle's number under a key (5.14)."""
    return number(np.uint64(corners[0]), key) ^ number(np.uint64(corners[1]), key) ^ number(np.uint64(corners[2]), key)


@numba.njit(nogil=True, cache=True)
def decide(positions, triangles, start, stop, inverse, key, shift, fate):  # type: ignore[no-untyped-def]
    """Fate of triangles start … stop - 1, uint8: DROPPED, KEPT with one point, or LARGE. Degenerate ones have no area: dropped."""
    for t in range(start, stop):
        ratio = ratio_of(positions, triangles[t], inverse)
        fate[t] = DROPPED
        if ratio > np.float32(1) and ratio < np.inf:
            fate[t] = LARGE
        elif ratio > np.float32(0) and ratio < np.inf and kept(of_corners(triangles[t], key) ^ shift, ratio):
            fate[t] = KEPT


@numba.njit(cache=True)
def keep_whole(positions, triangles, rows, inverse, keys, shifts, carry, numbers, chances, weights, where):  # type: ignore[no-untyped-def]
    """Points of triangles that are kept as they are: numbers uint64 (N, 2), chances, weights float32 (N,), where float32 (N, 2)."""
    for i in range(len(rows)):
        corners = triangles[rows[i]]
        ratio = ratio_of(positions, corners, inverse)
        numbers[i, 0], numbers[i, 1] = of_corners(corners, keys[0]) ^ shifts[0], of_corners(corners, keys[1]) ^ shifts[1]
        chances[i], weights[i] = carried(ratio, carry)
        where[i] = placed(numbers[i, 1])


@numba.njit(cache=True)
def carried(ratio, carry):  # type: ignore[no-untyped-def]
    """(probability, weight): a surplus of area over that of one point goes into the weight, so that nothing is lost."""
    if not carry:
        return ratio, np.float32(1)
    return min(ratio, np.float32(1)), max(ratio, np.float32(1))


@numba.njit(cache=True)
def cuts_of(ratio):  # type: ignore[no-untyped-def]
    """How often to cut into four before the tessellator's largest level is enough, and the ratio then."""
    times = 0
    while ratio > np.float32(MOST) and times < 12:
        ratio *= np.float32(0.25)
        times += 1
    return times, ratio


@numba.njit(cache=True)
def cell(path, times):  # type: ignore[no-untyped-def]
    """Quarter of a quarter of …: (u, v) of its first corner, and its signed size. Base-4 digits of path pick, 3 the middle one."""
    u, v, size = np.float32(0), np.float32(0), np.float32(1)
    for step in range(times):
        size *= np.float32(0.5)
        digit = (path >> (2 * (times - 1 - step))) & 3
        if digit == 1 or digit == 3:
            u += size
        if digit == 2 or digit == 3:
            v += size
        if digit == 3:
            size = -size
    return u, v, size


@numba.njit(cache=True)
def patches(positions, triangles, rows, inverse, keys, even, starts, patch, ratios, numbers):  # type: ignore[no-untyped-def]
    """Patches of large triangles. patch int32 (P, 4): triangle, path, cuts, level; ratios float32 (P,); numbers uint64 (P, 2)."""
    for i in range(len(rows)):
        corners = triangles[rows[i]]
        times, ratio = cuts_of(ratio_of(positions, corners, inverse))
        first, second = of_corners(corners, keys[0]), of_corners(corners, keys[1])
        n = level(ratio, even)
        for path in range(1 << (2 * times)):
            at = starts[i] + path
            patch[at, 0], patch[at, 1], patch[at, 2], patch[at, 3] = rows[i], path, times, n
            ratios[at] = ratio
            numbers[at, 0], numbers[at, 1] = number(np.uint64(path), first), number(np.uint64(path), second)


@numba.njit(cache=True)
def of_lattice(part, key):  # type: ignore[no-untyped-def]
    """Number of a part of a patch from its three lattice points (5.17), each hashed with the patch's own number as the key."""
    value = np.uint64(0)
    for k in range(3):
        value ^= number((np.uint64(part[k, 0]) << np.uint64(16)) | np.uint64(part[k, 1]), key)
    return value


@numba.njit(cache=True)
def chance_of(part, n, ratio):  # type: ignore[no-untyped-def]
    """Ratio of a part: exact in the lattice, whatever the tessellator's rounding."""
    twice = (part[1, 0] - part[0, 0]) * (part[2, 1] - part[0, 1]) - (part[1, 1] - part[0, 1]) * (part[2, 0] - part[0, 0])
    return ratio * np.float32(abs(twice)) / np.float32(9 * n * n)


@numba.njit(nogil=True, cache=True)
def count_parts(patch, ratios, numbers, begin, end, offsets, lattice, shift, counts):  # type: ignore[no-untyped-def]
    """Kept parts of patches begin … end - 1, int64. lattice[offsets[n] : offsets[n + 1]] is the pattern of level n."""
    for p in range(begin, end):
        n, found = patch[p, 3], 0
        for at in range(offsets[n], offsets[n + 1]):
            chance = chance_of(lattice[at], n, ratios[p])
            found += kept(of_lattice(lattice[at], numbers[p, 0]) ^ shift, chance)
        counts[p] = found


@numba.njit(nogil=True, cache=True)
def keep_parts(patch, ratios, numbers, begin, end, offsets, lattice, shifts, carry, starts, found, chances, weights, where):  # type: ignore[no-untyped-def]
    """Points of the kept parts, patch p's from starts[p] on; arrays as `keep_whole`, where: (u, v) in the whole triangle."""
    for p in range(begin, end):
        n, i = patch[p, 3], starts[p]
        u, v, size = cell(patch[p, 1], patch[p, 2])
        for at in range(offsets[n], offsets[n + 1]):
            part = lattice[at]
            chance, first = chance_of(part, n, ratios[p]), of_lattice(part, numbers[p, 0]) ^ shifts[0]
            if not kept(first, chance):
                continue
            found[i, 0], found[i, 1] = first, of_lattice(part, numbers[p, 1]) ^ shifts[1]
            chances[i], weights[i] = carried(chance, carry)
            b, c = placed(found[i, 1])
            for k in range(2):
                inside = np.float32(part[0, k]) + b * np.float32(part[1, k] - part[0, k]) + c * np.float32(part[2, k] - part[0, k])
                where[i, k] = (u if k == 0 else v) + size * (inside / np.float32(3 * n))
            i += 1
