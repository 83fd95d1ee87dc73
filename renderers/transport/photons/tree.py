"""A balanced kd-tree over photon positions (numba). Its nodes are implicit: node i of level l owns rows i·n/2ˡ … (i+1)·n/2ˡ.

Building puts the photons into tree order, so that a leaf is a run of rows. Queries keep only what passes a surface filter: the
normal within `cos_min` of the query's, and the height over its tangent plane at most `height`. cos_min = -2 keeps all.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

LEAF = 12
STACK = 64


class Tree(NamedTuple):
    """axis int8 and value float32 of the splits (2^levels - 1,), breadth first; positions, normals float32 (N, 3) in tree order."""

    axis: NDArray[np.int8]
    value: NDArray[np.float32]
    levels: int
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]


def build(positions: NDArray[np.float32]) -> tuple[NDArray[np.int8], NDArray[np.float32], int, NDArray[np.int64]]:
    """(axis, value, levels, order) of a tree over positions (N, 3); order int64 (N,) lists photons in tree order."""
    count, levels = len(positions), 0
    while count >> levels > LEAF:
        levels += 1
    order = np.arange(count, dtype=np.int64)
    moved = np.ascontiguousarray(positions, np.float32).copy()
    axis, value = np.zeros((1 << levels) - 1, np.int8), np.zeros((1 << levels) - 1, np.float32)
    for level in range(levels):
        _split_level(moved, order, level, axis, value)
    return axis, value, levels, order


@numba.njit(parallel=True, cache=True)
def _split_level(moved, order, level, axis, value):  # type: ignore[no-untyped-def]
    count = len(order)
    for i in numba.prange(1 << level):
        low, high = (count * i) >> level, (count * (i + 1)) >> level
        middle = (count * (2 * i + 1)) >> (level + 1)
        best, extent = 0, np.float32(-1)
        for a in range(3):
            smallest, largest = moved[low, a], moved[low, a]
            for j in range(low, high):
                smallest = min(smallest, moved[j, a])
                largest = max(largest, moved[j, a])
            if largest - smallest > extent:
                best, extent = a, largest - smallest
        _select(moved, order, low, high - 1, middle, best)
        node = (1 << level) - 1 + i
        axis[node], value[node] = best, moved[middle, best]


@numba.njit(cache=True)
def _select(moved, order, low, high, k, a):  # type: ignore[no-untyped-def]
    """Quickselect (Hoare): afterwards rows low…k-1 ≤ row k ≤ rows k+1…high on axis a."""
    while low < high:
        pivot = moved[(low + high) >> 1, a]
        i, j = low, high
        while i <= j:
            while moved[i, a] < pivot:
                i += 1
            while moved[j, a] > pivot:
                j -= 1
            if i <= j:
                for c in range(3):
                    moved[i, c], moved[j, c] = moved[j, c], moved[i, c]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            return


@numba.njit(inline="always")
def _distance2(tree, j, p, n, cos_min, height):  # type: ignore[no-untyped-def]
    """Squared distance of row j, or infinity where it fails the filter."""
    x, y, z = tree.positions[j, 0] - p[0], tree.positions[j, 1] - p[1], tree.positions[j, 2] - p[2]
    if cos_min > -2.0:
        cosine = tree.normals[j, 0] * n[0] + tree.normals[j, 1] * n[1] + tree.normals[j, 2] * n[2]
        if cosine <= cos_min or abs(x * n[0] + y * n[1] + z * n[2]) > height:
            return np.inf
    return x * x + y * y + z * z


@numba.njit(nogil=True, cache=True)
def within(tree, p, n, radius, cos_min, height, found):  # type: ignore[no-untyped-def]
    """Rows of photons within `radius` of p that pass the filter: (array, count); `found` is used, or a longer copy of it."""
    total, count, reach2 = len(tree.positions), 0, radius * radius
    nodes, levels = np.empty(STACK, np.int64), np.empty(STACK, np.int64)
    top = 1 if total else 0
    nodes[0], levels[0] = 0, 0
    while top:
        top -= 1
        i, level = nodes[top], levels[top]
        if level < tree.levels:
            node = (1 << level) - 1 + i
            side = p[tree.axis[node]] - tree.value[node]
            for child in range(2):
                if side * side <= reach2 or (side > 0) == (child == 1):
                    nodes[top], levels[top] = 2 * i + child, level + 1
                    top += 1
            continue
        for j in range((total * i) >> level, (total * (i + 1)) >> level):
            if _distance2(tree, j, p, n, cos_min, height) <= reach2:
                if count == len(found):
                    longer = np.empty(2 * count + 16, found.dtype)
                    longer[:count] = found
                    found = longer
                found[count] = j
                count += 1
    return found, count


@numba.njit(nogil=True, cache=True)
def nearest(tree, p, n, reach, cos_min, height, rows, distances2):  # type: ignore[no-untyped-def]
    """The nearest len(rows) photons within `reach` that pass the filter: fills rows and squared distances, returns how many.

    If all places are filled, rows[0] is the farthest (a max-heap).
    """
    total, k, count, reach2 = len(tree.positions), len(rows), 0, reach * reach
    nodes, levels, gaps = np.empty(STACK, np.int64), np.empty(STACK, np.int64), np.empty(STACK)
    top = 1 if total else 0
    nodes[0], levels[0], gaps[0] = 0, 0, 0.0
    while top:
        top -= 1
        i, level, gap = nodes[top], levels[top], gaps[top]
        if gap > reach2:
            continue
        if level < tree.levels:
            node = (1 << level) - 1 + i
            side = p[tree.axis[node]] - tree.value[node]
            near = 1 if side > 0 else 0
            nodes[top], levels[top], gaps[top] = 2 * i + 1 - near, level + 1, max(gap, side * side)
            nodes[top + 1], levels[top + 1], gaps[top + 1] = 2 * i + near, level + 1, gap
            top += 2
            continue
        for j in range((total * i) >> level, (total * (i + 1)) >> level):
            d2 = _distance2(tree, j, p, n, cos_min, height)
            if d2 > reach2 or d2 == np.inf:
                continue
            if count < k:
                rows[count], distances2[count] = j, d2
                count += 1
                _sift_up(rows, distances2, count - 1)
                if count == k:
                    reach2 = distances2[0]
            elif d2 < distances2[0]:
                rows[0], distances2[0] = j, d2
                _sift_down(rows, distances2, k)
                reach2 = distances2[0]
    return count


@numba.njit(inline="always")
def _sift_up(rows, keys, i):  # type: ignore[no-untyped-def]
    while i > 0:
        parent = (i - 1) >> 1
        if keys[parent] >= keys[i]:
            break
        rows[parent], rows[i] = rows[i], rows[parent]
        keys[parent], keys[i] = keys[i], keys[parent]
        i = parent


@numba.njit(inline="always")
def _sift_down(rows, keys, count):  # type: ignore[no-untyped-def]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= count:
            break
        if child + 1 < count and keys[child + 1] > keys[child]:
            child += 1
        if keys[i] >= keys[child]:
            break
        rows[i], rows[child] = rows[child], rows[i]
        keys[i], keys[child] = keys[child], keys[i]
        i = child
