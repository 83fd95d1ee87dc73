"""numba kernels that walk a `LightTree` for every pixel: a cut by solid angle, and a cut of stochastically sampled nodes.

Pixels are independent of each other and each walks in one order: the same bytes at any thread count.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.scene.world import LAMBERT
from renderers.transport.kernels import SAFE_R2, shade

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
def add_light(x, n, view, kind, base, specular, exponent, metallic, alpha, y, ny, intensity, factor, eps_b, out):  # type: ignore[no-untyped-def]
    """out (3,) += f G_b · factor · intensity of a light at y with normal ny (not always of unit length)."""
    vx, vy, vz = y[0] - x[0], y[1] - x[1], y[2] - x[2]
    r2 = vx * vx + vy * vy + vz * vz
    cx = n[0] * vx + n[1] * vy + n[2] * vz
    cy = -(ny[0] * vx + ny[1] * vy + ny[2] * vz)
    if cx <= 0 or cy <= 0 or r2 <= SAFE_R2:
        return
    g = factor * cx * cy / (r2 * max(eps_b, r2))
    if kind == LAMBERT:
        for c in range(3):
            out[c] += base[c] / np.pi * g * intensity[c]
        return
    r = np.sqrt(r2)
    weight = np.array([g * intensity[0], g * intensity[1], g * intensity[2]])
    shade(kind, base, specular, exponent, metallic, alpha, (n[0], n[1], n[2]), (view[0], view[1], view[2]),
          (vx / r, vy / r, vz / r), weight, out)  # fmt: skip


@numba.njit(parallel=True, cache=True)
def solid_angle_cut(  # type: ignore[no-untyped-def]
    x,
    n,
    view,
    kind,
    base,
    specular,
    exponent,
    metallic,
    alpha,
    box,
    cone,
    position,
    normal,
    intensity,
    count,
    right,
    roots,
    area,
    threshold,
    begin,
    end,
    places,
    listed,
    factors,
    eps_b,
    out,
    work,
):
    """out (P, 3) += light of each pixel's cut, pixels begin … end-1; work (P, 2) int64: nodes of the cut, nodes visited.

    A node of k lights has area k · `area`; it is opened while area · cos θ_y / r² may exceed `threshold` somewhere in it.
    With places (P+1,) nothing is lit: the nodes of pixel i go to listed[places[i]:], and 1 to `factors` (see `add_listed`).
    """
    for i in numba.prange(begin, end):
        work[i, 0] = work[i, 1] = 0
        stack = np.empty(DEPTH, np.int32)
        for root in roots:
            stack[0] = root
            height = 1
            while height:
                height -= 1
                node = stack[height]
                work[i, 1] += 1
                near, _, _, cos_y = bounds(x[i], n[i], box[node], cone[node])
                if right[node] >= 0 and count[node] * area * cos_y > threshold * near:
                    stack[height], stack[height + 1] = right[node], node + 1
                    height += 2
                    continue
                work[i, 0] += 1
                if len(places):
                    place = places[i] + work[i, 0] - 1
                    listed[place], factors[place] = node, 1.0
                    continue
                add_light(
                    x[i], n[i], view[i], kind[i], base[i], specular[i], exponent[i], metallic[i], alpha[i],
                    position[node], normal[node], intensity[node], 1.0, eps_b, out[i],
                )  # fmt: skip


@numba.njit(parallel=True, cache=True)
def add_listed(  # type: ignore[no-untyped-def]
    x, n, view, kind, base, specular, exponent, metallic, alpha, position, normal, intensity,
    begin, end, places, listed, factors, eps_b, out,
):  # fmt: skip
    """out (P, 3) += light of the listed nodes of pixels begin … end-1, times their factors; -1 stands for none."""
    for i in numba.prange(begin, end):
        for k in range(places[i], places[i + 1]):
            node = listed[k]
            if node >= 0:
                add_light(
                    x[i], n[i], view[i], kind[i], base[i], specular[i], exponent[i], metallic[i], alpha[i],
                    position[node], normal[node], intensity[node], factors[k], eps_b, out[i],
                )  # fmt: skip


@numba.njit(inline="always")
def mixed(key):  # type: ignore[no-untyped-def]
    """splitmix64: a well-mixed 64-bit number of a counter."""
    z = key + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@numba.njit(cache=True)
def sampled_leaf(x, n, node, u, box, cone, intensity, right, eps_b):  # type: ignore[no-untyped-def]
    """Descend to one light: children by intensity × geometry, half by least and half by greatest distance (Yuksel 2019 §4).

    Returns the leaf (-1: none can light x) and its probability."""
    probability = 1.0
    while right[node] >= 0:
        one, other = node + 1, right[node]
        near_a, far_a, ax, ay = bounds(x, n, box[one], cone[one])
        near_b, far_b, bx, by = bounds(x, n, box[other], cone[other])
        a, b = intensity[one].sum() * ax * ay, intensity[other].sum() * bx * by
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
def error_bound(x, n, node, box, cone, intensity, right, eps_b):  # type: ignore[no-untyped-def]
    """Greatest light a node may bring (over f), 0 for a leaf, which needs no refinement."""
    if right[node] < 0:
        return 0.0
    near, _, cos_x, cos_y = bounds(x, n, box[node], cone[node])
    return intensity[node].sum() * cos_x * cos_y / max(eps_b, near, 1e-12)


@numba.njit(parallel=True, cache=True)
def stochastic_cut(  # type: ignore[no-untyped-def]
    x,
    n,
    view,
    kind,
    base,
    specular,
    exponent,
    metallic,
    alpha,
    box,
    cone,
    position,
    normal,
    intensity,
    count,
    right,
    roots,
    cut_size,
    tolerance,
    seed,
    begin,
    end,
    places,
    listed,
    factors,
    eps_b,
    out,
    work,
):
    """out (P, 3) += one sampled light of each node of each pixel's cut, over its probability; work (P, 2): nodes cut, visited.

    The node of the greatest error bound is split until there are cut_size nodes or all bounds are below tolerance · their sum.
    Pixels and lists as in `solid_angle_cut`; factors are 1 over the probability.
    """
    for i in numba.prange(begin, end):
        cut, error = np.empty(cut_size + len(roots), np.int32), np.empty(cut_size + len(roots))
        size, total = len(roots), 0.0
        for k in range(size):
            cut[k] = roots[k]
            error[k] = error_bound(x[i], n[i], cut[k], box, cone, intensity, right, eps_b)
            total += error[k]
        visited = size
        while size < cut_size:
            worst = np.argmax(error[:size])
            if error[worst] <= tolerance * total:
                break
            total -= error[worst]
            node = cut[worst]
            cut[worst], cut[size] = node + 1, right[node]
            for child in (worst, size):
                error[child] = error_bound(x[i], n[i], cut[child], box, cone, intensity, right, eps_b)
                total += error[child]
            size += 1
            visited += 2
        key = mixed(np.uint64(seed) ^ mixed(np.uint64(i)))
        for k in range(size):
            u = float(mixed(key + np.uint64(cut[k])) >> np.uint64(11)) * 2.0**-53
            leaf, probability = sampled_leaf(x[i], n[i], cut[k], u, box, cone, intensity, right, eps_b)
            if len(places):
                listed[places[i] + k], factors[places[i] + k] = leaf, 1.0 / probability
            elif leaf >= 0:
                add_light(
                    x[i], n[i], view[i], kind[i], base[i], specular[i], exponent[i], metallic[i], alpha[i],
                    position[leaf], normal[leaf], intensity[leaf], 1.0 / probability, eps_b, out[i],
                )  # fmt: skip
        work[i, 0], work[i, 1] = size, visited
