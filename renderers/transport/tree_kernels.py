"""numba kernels that walk a `LightTree` for every pixel: a cut by solid angle, and a cut of stochastically sampled nodes.

Pixels are independent of each other and each walks in one order: the same bytes at any thread count. pixels: `kernels.Receivers` in
float64; tree: `light_tree.LightTree`. Where places (P+1,) are given, nodes are listed instead of lit: those of pixel i, and what
their light is to be multiplied by, from listed[places[i]] and factors[places[i]] on. (Parallel loops write to no array in a tuple.)
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.kernels import SAFE_R2, reflect

DEPTH = 64


@numba.njit(inline="always")
def bounds(x, n, box, cone):  # type: ignore[no-untyped-def]
    """Squared distance of receiver x from a node's box, least and greatest; bounds of cos θ_x and cos θ_y over the node, 0 … 1."""
    near = far = facing = emitting = 0.0
    for c in range(3):
        low, high = box[0, c] - x[c], box[1, c] - x[c]
        gap = max(low, -high, 0.0)
        near += gap * gap
        far += max(low * low, high * high)
        facing += max(n[c] * low, n[c] * high)
        emitting += max(-cone[0, c] * low, -cone[0, c] * high, -cone[1, c] * low, -cone[1, c] * high)
    distance = np.sqrt(near)
    cos_x = 1.0 if distance <= facing else max(0.0, facing / distance)
    cos_y = 1.0 if distance <= emitting else max(0.0, emitting / distance)
    return near, far, cos_x, cos_y


@numba.njit(inline="always")
def add_light(pixels, i, tree, node, factor, eps_b, out):  # type: ignore[no-untyped-def]
    """out[i] += f G_b · factor · intensity of a node, whose normal is not always of unit length."""
    x, n, y, ny, intensity = pixels.position[i], pixels.normal[i], tree.position[node], tree.normal[node], tree.intensity[node]
    vx, vy, vz = y[0] - x[0], y[1] - x[1], y[2] - x[2]
    r2 = vx * vx + vy * vy + vz * vz
    cx = n[0] * vx + n[1] * vy + n[2] * vz
    cy = -(ny[0] * vx + ny[1] * vy + ny[2] * vz)
    if cx <= 0 or cy <= 0 or r2 <= SAFE_R2:
        return
    g = factor * cx * cy / (r2 * max(eps_b, r2))
    reflect(pixels, i, (vx, vy, vz), r2, (g * intensity[0], g * intensity[1], g * intensity[2]), out)


@numba.njit(inline="always")
def light_or_list(pixels, i, tree, node, factor, place, places, listed, factors, eps_b, out):  # type: ignore[no-untyped-def]
    """Note a node (-1: none) in the place-th place of pixel i where nodes are listed, else add its light."""
    if len(places):
        listed[places[i] + place], factors[places[i] + place] = node, factor
    elif node >= 0:
        add_light(pixels, i, tree, node, factor, eps_b, out)


@numba.njit(parallel=True, cache=True)
def solid_angle_cut(pixels, tree, area, threshold, begin, end, places, listed, factors, eps_b, out, work):  # type: ignore[no-untyped-def]
    """out (P, 3) += light of each pixel's cut, pixels begin … end-1; work (P, 2) int64: nodes of the cut, nodes visited.

    A node of k lights has area k · `area`; it is opened while area · cos θ_y / r² may exceed `threshold` somewhere in it.
    """
    for i in numba.prange(begin, end):
        work[i, 0] = work[i, 1] = 0
        stack = np.empty(DEPTH, np.int32)
        for root in tree.roots:
            stack[0] = root
            height = 1
            while height:
                height -= 1
                node = stack[height]
                work[i, 1] += 1
                near, _, _, cos_y = bounds(pixels.position[i], pixels.normal[i], tree.box[node], tree.cone[node])
                if tree.right[node] >= 0 and tree.leaves[node] * area * cos_y > threshold * near:
                    stack[height], stack[height + 1] = tree.right[node], node + 1
                    height += 2
                    continue
                light_or_list(pixels, i, tree, node, 1.0, work[i, 0], places, listed, factors, eps_b, out)
                work[i, 0] += 1


@numba.njit(parallel=True, cache=True)
def add_listed(pixels, tree, begin, end, places, listed, factors, eps_b, out):  # type: ignore[no-untyped-def]
    """out (P, 3) += light of the listed nodes of pixels begin … end-1, times their factors."""
    for i in numba.prange(begin, end):
        for k in range(places[i], places[i + 1]):
            if listed[k] >= 0:
                add_light(pixels, i, tree, listed[k], factors[k], eps_b, out)


@numba.njit(inline="always")
def mixed(key):  # type: ignore[no-untyped-def]
    """splitmix64: a well-mixed 64-bit number of a counter."""
    z = key + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@numba.njit(cache=True)
def sampled_leaf(x, n, node, u, tree, eps_b):  # type: ignore[no-untyped-def]
    """Descend to one light: children by intensity × geometry, half by least and half by greatest distance (Yuksel 2019 §4).

    Returns the leaf (-1: none can light x) and its probability."""
    probability = 1.0
    while tree.right[node] >= 0:
        one, other = node + 1, tree.right[node]
        near_a, far_a, ax, ay = bounds(x, n, tree.box[one], tree.cone[one])
        near_b, far_b, bx, by = bounds(x, n, tree.box[other], tree.cone[other])
        a, b = tree.intensity[one].sum() * ax * ay, tree.intensity[other].sum() * bx * by
        if a + b <= 0:
            return -1, 1.0
        least = (a / max(eps_b, near_a, 1e-12), b / max(eps_b, near_b, 1e-12))
        if near_a == 0 or near_b == 0:
            least = a, b
        most = a / max(eps_b, far_a), b / max(eps_b, far_b)
        p = 0.5 * (least[0] / (least[0] + least[1]) + most[0] / (most[0] + most[1]))
        if u < p:
            node, u, probability = one, u / p, probability * p
        else:
            node, u, probability = other, (u - p) / (1 - p), probability * (1 - p)
        u = min(u, 1 - 2.0**-53)
    return node, probability


@numba.njit(inline="always")
def error_bound(x, n, node, tree, eps_b):  # type: ignore[no-untyped-def]
    """Greatest light a node may bring (over f), 0 for a leaf, which needs no refinement."""
    if tree.right[node] < 0:
        return 0.0
    near, _, cos_x, cos_y = bounds(x, n, tree.box[node], tree.cone[node])
    return tree.intensity[node].sum() * cos_x * cos_y / max(eps_b, near, 1e-12)


@numba.njit(cache=True)
def refined(x, n, tree, cut_size, tolerance, eps_b, cut):  # type: ignore[no-untyped-def]
    """Fill `cut` with the roots, then split the node of the greatest error bound until there are cut_size nodes or all bounds are
    below tolerance · their sum. Returns the number of nodes."""
    error = np.empty(len(cut))
    size, total = len(tree.roots), 0.0
    for k in range(size):
        cut[k] = tree.roots[k]
        error[k] = error_bound(x, n, cut[k], tree, eps_b)
        total += error[k]
    while size < cut_size:
        worst = np.argmax(error[:size])
        if error[worst] <= tolerance * total:
            break
        total -= error[worst]
        node = cut[worst]
        cut[worst], cut[size] = node + 1, tree.right[node]
        for child in (worst, size):
            error[child] = error_bound(x, n, cut[child], tree, eps_b)
            total += error[child]
        size += 1
    return size


@numba.njit(parallel=True, cache=True)
def stochastic_cut(pixels, tree, cut_size, tolerance, seed, begin, end, places, listed, factors, eps_b, out, work):  # type: ignore[no-untyped-def]
    """out (P, 3) += one sampled light of each node of each pixel's cut (`refined`), over its probability.

    Pixels and work as in `solid_angle_cut`; factors are 1 over the probability.
    """
    for i in numba.prange(begin, end):
        x, n = pixels.position[i], pixels.normal[i]
        cut = np.empty(cut_size + len(tree.roots), np.int32)
        size = refined(x, n, tree, cut_size, tolerance, eps_b, cut)
        key = mixed(np.uint64(seed) ^ mixed(np.uint64(i)))
        for k in range(size):
            u = float(mixed(key + np.uint64(cut[k])) >> np.uint64(11)) * 2.0**-53
            leaf, probability = sampled_leaf(x, n, cut[k], u, tree, eps_b)
            light_or_list(pixels, i, tree, leaf, 1.0 / probability, k, places, listed, factors, eps_b, out)
        # each split visits two nodes and makes one more
        work[i, 0], work[i, 1] = size, 2 * size - len(tree.roots)
