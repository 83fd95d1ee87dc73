"""A binary tree over virtual lights for backward cuts: by octant of the normal first, then by medians of position.

Nodes lie in depth-first order: the left child of node i is i + 1, `right[i]` the other one (-1 for a leaf). Each octant in use has
a tree of its own, `roots`, so that lights of one node look about the same way.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.vpl import Vpls

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


class LightTree(NamedTuple):
    """n nodes. box (n, 2, 3): lowest and highest position; cone (n, 2, 3): lowest and highest normal components; position, normal
    (n, 3): means weighted by the sum of the intensity's channels, the normal's not of unit length; intensity (n, 3): sum; leaves
    int32 (n,): lights below; right int32 (n,); roots int32 (R,). All others float64.
    """

    box: F64
    cone: F64
    position: F64
    normal: F64
    intensity: F64
    leaves: I32
    right: I32
    roots: I32


def build(vpls: Vpls) -> LightTree:
    """Tree of L ≥ 0 lights, 2L - R nodes."""
    octant = (vpls.normals >= 0) @ np.array([1, 2, 4])
    order = np.argsort(octant, kind="stable")
    sizes = np.bincount(octant, minlength=8)
    sizes = sizes[sizes > 0]
    n = int(2 * len(order) - len(sizes))
    light, right, count = np.full(n, -1, np.int64), np.full(n, -1, np.int32), np.ones(n, np.int32)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    roots = (2 * starts[:-1] - np.arange(len(sizes))).astype(np.int32)
    for root, first, last in zip(roots, starts[:-1], starts[1:], strict=True):
        _split(vpls.positions, order, int(first), int(last), int(root), light, right, count)
    tree = LightTree(
        np.zeros((n, 2, 3)), np.zeros((n, 2, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), count, right, roots
    )
    leaf = right < 0
    own = light[leaf]
    tree.box[leaf] = vpls.positions[own][:, None]
    tree.cone[leaf] = vpls.normals[own][:, None]
    tree.position[leaf], tree.normal[leaf], tree.intensity[leaf] = vpls.positions[own], vpls.normals[own], vpls.intensities[own]
    _sum_up(tree.box, tree.cone, tree.position, tree.normal, tree.intensity, right)
    return tree


@numba.njit(cache=True)
def _split(positions, order, first, last, root, light, right, count):  # type: ignore[no-untyped-def]
    """Nodes of order[first:last] from `root` on; the longest side of the bounds is cut at the median."""
    stack = [(first, last, root)]
    while stack:
        a, b, node = stack.pop()
        count[node] = b - a
        if b - a == 1:
            light[node] = order[a]
            continue
        low, high = positions[order[a]].copy(), positions[order[a]].copy()
        for k in range(a, b):
            low, high = np.minimum(low, positions[order[k]]), np.maximum(high, positions[order[k]])
        axis = np.argmax(high - low)
        keys = np.empty(b - a, np.float32)
        for k in range(a, b):
            keys[k - a] = positions[order[k], axis]
        order[a:b] = order[a:b][np.argsort(keys, kind="mergesort")]
        middle = (a + b) // 2
        right[node] = node + 2 * (middle - a)
        stack.append((middle, b, right[node]))
        stack.append((a, middle, node + 1))


@numba.njit(cache=True)
def _sum_up(box, cone, position, normal, intensity, right):  # type: ignore[no-untyped-def]
    """Bounds and means of inner nodes from their children's, which lie behind them."""
    for node in range(len(right) - 1, -1, -1):
        if right[node] < 0:
            continue
        one, other = node + 1, right[node]
        box[node, 0], box[node, 1] = np.minimum(box[one, 0], box[other, 0]), np.maximum(box[one, 1], box[other, 1])
        cone[node, 0], cone[node, 1] = np.minimum(cone[one, 0], cone[other, 0]), np.maximum(cone[one, 1], cone[other, 1])
        intensity[node] = intensity[one] + intensity[other]
        share = intensity[one].sum() / intensity[node].sum()
        position[node] = share * position[one] + (1 - share) * position[other]
        normal[node] = share * normal[one] + (1 - share) * normal[other]
