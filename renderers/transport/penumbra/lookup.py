"""Evaluation of packed attenuation functions (numba kernels).

V at a point is the bilinear blend of the functions of the four pixels around its tangents, all at its own depth Z: results are
filtered, never depths or vertices (St-Amour 2004 §4.1). A vertex at exactly Z is not passed yet, as the shadow test D + b < Z is
strict.
"""

from __future__ import annotations

import numba
import numpy as np

UNCOVERED = np.float32(-1)


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


@numba.njit(parallel=True, cache=True)
def evaluate(points, window, width, height, start, depth, value, bilinear, out):  # type: ignore[no-untyped-def]
    """out float32 (P,): V at points float64 (P, 3) of the pyramid's frame, UNCOVERED outside of it. window: u_0, v_0, pitch, near,
    far.
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
        if not bilinear:
            pixel = min(int(gy), height - 1) * width + min(int(gx), width - 1)
            out[i] = value_at(depth, value, start[pixel], start[pixel + 1], z)
            continue
        x, y = int(np.floor(gx - 0.5)), int(np.floor(gy - 0.5))
        wx, wy = gx - 0.5 - x, gy - 0.5 - y
        total = 0.0
        for b in range(2):
            row = min(max(y + b, 0), height - 1)
            for a in range(2):
                column = min(max(x + a, 0), width - 1)
                pixel = row * width + column
                weight = (wx if a else 1 - wx) * (wy if b else 1 - wy)
                total += weight * value_at(depth, value, start[pixel], start[pixel + 1], z)
        out[i] = min(max(total, 0.0), 1.0)
