"""Evaluation of packed attenuation functions (numba kernels).

V at a point is the bilinear blend of the functions of the four pixels around its tangents: results are filtered, never depths or
vertices (St-Amour 2004 §4.1). A vertex at exactly Z is not passed yet, as the shadow test D + b < Z is strict.

All four are read at the point's own depth Z. That a surface does not hide itself is the business of the maps' bias (`depth`).
Without one, points with normals can be read where each function's own ray meets the surface's plane, moved to the light's side by

    h = c_S Δu_S Z (|n_x| + |n_y|)

A shadow map's texel of pitch Δu_S stands for points up to half a texel away (c_S = 1/2; midpoint walk 3/2), where the plane's depth
differs by Δu_S Z |n_x| / (2 |n·d|) in direction d, and the moved plane is just h / |n·d| before it. So h is the least that leaves
every plane unshadowed by itself, whatever its slope, and at most 0.71 of a texel's footprint.
"""

from __future__ import annotations

import numba
import numpy as np

UNCOVERED = np.float32(-1)
# footprints of a pixel that a lookup may move along its ray (1 to 4 are alike in error), and what a ray counts that stays behind
# the surface that far
REACH, HARDLY = 2.0, 1e-6


@numba.njit(inline="always")
def value_at(depth, value, first, last, z):  # type: ignore[no-untyped-def]
    """V'(z) of the function with vertices first … last - 1: 0 before the first, linear between, constant after the last."""
    low, high = first, last
    while low < high:
        middle = (low + high) // 2
        if depth[middle] >= z:
            high = middle
        else:
            low = middle + 1
    if low == first:
        return 0.0
    if low == last:
        return float(value[last - 1])
    z0, z1 = float(depth[low - 1]), float(depth[low])
    v0, v1 = float(value[low - 1]), float(value[low])
    return v0 + (v1 - v0) * (z - z0) / (z1 - z0)


@numba.njit(inline="always")
def depth_on_plane(z, n, height, u, v, reach):  # type: ignore[no-untyped-def]
    """(depth, weight) at which a receiver at depth z is looked up on the ray (u, v, 1): where the ray meets the plane n·X = height.

    Further than `reach` before the plane it stays before it; a ray that is behind the plane for that long has next to no weight.
    """
    across = n[0] * u + n[1] * v + n[2]
    away = height >= 0
    if (across > 0) != away or across == 0:
        return (z, HARDLY) if away else (z + reach, 1.0)
    meets = height / across
    if meets < z - reach:
        return (z - reach, 1.0) if away else (meets, HARDLY)
    if meets > z + reach:
        return (meets, HARDLY) if away else (z + reach, 1.0)
    return meets, 1.0


@numba.njit(parallel=True, cache=True)
def evaluate(points, normals, window, width, height, start, depth, value, bilinear, out):  # type: ignore[no-untyped-def]
    """out float32 (P,): V at points float64 (P, 3) of the pyramid's frame, UNCOVERED outside of it.

    normals float64 (P, 3): of the receiving surfaces, zeros in free space. window: u_0, v_0, pitch, near, far, lift.
    """
    for i in numba.prange(len(points)):
        z = points[i, 2]
        if not (z >= window[3] and z <= window[4]):
            out[i] = UNCOVERED
            continue
        gx = (points[i, 0] / z - window[0]) / window[2]
        gy = (points[i, 1] / z - window[1]) / window[2]
        if not (gx >= 0 and gx <= width and gy >= 0 and gy <= height):
            out[i] = UNCOVERED
            continue
        n = (normals[i, 0], normals[i, 1], normals[i, 2])
        free = n[0] == 0 and n[1] == 0 and n[2] == 0
        reach = REACH * window[2] * z
        plane = n[0] * points[i, 0] + n[1] * points[i, 1] + n[2] * z + window[5] * (z + reach) * (abs(n[0]) + abs(n[1]))
        first_x, first_y = (gx - 0.5, gy - 0.5) if bilinear else (np.floor(gx), np.floor(gy))
        x, y = int(np.floor(first_x)), int(np.floor(first_y))
        wx, wy = first_x - x, first_y - y
        total, weights = 0.0, 0.0
        for b in range(2):
            row = min(max(y + b, 0), height - 1)
            for a in range(2):
                column = min(max(x + a, 0), width - 1)
                weight = (wx if a else 1 - wx) * (wy if b else 1 - wy)
                if weight == 0:
                    continue
                at = z
                if not free:
                    u, v = window[0] + (column + 0.5) * window[2], window[1] + (row + 0.5) * window[2]
                    at, kept = depth_on_plane(z, n, plane, u, v, reach)
                    weight *= kept
                pixel = row * width + column
                total += weight * value_at(depth, value, start[pixel], start[pixel + 1], min(max(at, window[3]), window[4]))
                weights += weight
        out[i] = min(max(total / weights, 0.0), 1.0)
