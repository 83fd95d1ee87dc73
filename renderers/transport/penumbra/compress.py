"""Compression of one attenuation function V into few line segments V' (numba kernels).

Input is the step form: each change of V at z_k gives two points, (z_k, V_{k-1}) and (z_k, V_k), z not falling. V' is 0 before its
first vertex, linear between vertices, constant after the last; of two vertices at one z the first is the limit from the left.

Vertical (Lokovic & Veach 2000, St-Amour 2004 §3.2). From an origin, every point allows the slopes that pass it within ±ε; windows
are intersected until none is left, then the segment ends at the last point with the mean slope. |V' - V| ≤ ε everywhere, from both
sides of a jump: between points both are linear, and at each point V' lies in the window. Windows are clipped to [0, 1] instead of
the vertices, because moving a vertex afterwards would tilt its segment out of the bound.

Perpendicular (St-Amour 2004 §3.2, in a sound form). ε is a distance in the plane (κ (z - near) / (far - near), V): every point lies
within ε of the polyline, so a steep part may move by ε (far - near) / κ in depth, and needs far fewer vertices.
"""

from __future__ import annotations

import numba
import numpy as np

NONE, VERTICAL, PERPENDICULAR = 0, 1, 2


@numba.njit(nogil=True, cache=True)
def compress(z, v, n, method, epsilon, scale, out_z, out_v):  # type: ignore[no-untyped-def]
    """Vertices of V' for the first n points of z, v (float64): fills out_z, out_v (room for n + 2), returns their number.

    method: NONE, VERTICAL or PERPENDICULAR; scale: κ / (far - near), the last one's unit of depth.
    """
    if n == 0:
        return 0
    if method == VERTICAL:
        m = vertical(z, v, n, epsilon, out_z, out_v)
    elif method == PERPENDICULAR:
        m = perpendicular(z, v, n, epsilon, scale, out_z, out_v)
    else:
        out_z[:n], out_v[:n] = z[:n], v[:n]
        m = n
    # a leading (z, 0) under a jump says what holds before the first vertex anyway
    if m > 1 and out_v[0] == 0 and out_z[0] == out_z[1]:
        for k in range(m - 1):
            out_z[k], out_v[k] = out_z[k + 1], out_v[k + 1]
        m -= 1
    return m


@numba.njit(nogil=True, cache=True)
def fitted(z, v, n, method, epsilon, scale, budget, out_z, out_v):  # type: ignore[no-untyped-def]
    """`compress` with the least tolerance (to a millionth) above epsilon that needs no more than `budget` vertices, at least 2.

    Uncompressed functions (NONE) are fitted by the vertical metric. Tolerance 1 allows a constant: two vertices always do.
    """
    low, high = epsilon, 1.0
    metric = VERTICAL if method == NONE else method
    while high - low > 1e-6:
        middle = (low + high) / 2
        if compress(z, v, n, metric, middle, scale, out_z, out_v) <= budget:
            high = middle
        else:
            low = middle
    return compress(z, v, n, metric, high, scale, out_z, out_v)


@numba.njit(nogil=True, cache=True)
def vertical(z, v, n, epsilon, out_z, out_v):  # type: ignore[no-untyped-def]
    """Greedy slope windows; |V' - V| ≤ epsilon and V' in [0, 1]. Arrays as in `compress`."""
    z0, v0 = z[0], v[0]
    out_z[0], out_v[0] = z0, v0
    m, j, pending = 1, 1, False
    low, high = -np.inf, np.inf
    while j < n:
        if z[j] == z0:
            if abs(v[j] - v0) <= epsilon:
                j += 1
                continue
            while j + 1 < n and z[j + 1] == z0:
                j += 1
            v0 = v[j]
            out_z[m], out_v[m] = z0, v0
            m, j = m + 1, j + 1
            low, high, pending = -np.inf, np.inf, False
            continue
        first = max(low, (max(0.0, v[j] - epsilon) - v0) / (z[j] - z0))
        second = min(high, (min(1.0, v[j] + epsilon) - v0) / (z[j] - z0))
        if first <= second:
            low, high, pending = first, second, True
            j += 1
            continue
        v0 += (low + high) / 2 * (z[j - 1] - z0)
        z0 = z[j - 1]
        out_z[m], out_v[m] = z0, v0
        m += 1
        low, high, pending = -np.inf, np.inf, False
    if pending:
        out_z[m], out_v[m] = z[n - 1], v0 + (low + high) / 2 * (z[n - 1] - z0)
        m += 1
    return m


@numba.njit(nogil=True, cache=True)
def perpendicular(z, v, n, epsilon, scale, out_z, out_v):  # type: ignore[no-untyped-def]
    """Cones of directions instead of slope windows; every point within epsilon of the polyline in the scaled plane."""
    ox, oy = z[0] * scale, v[0]
    out_z[0], out_v[0] = z[0], v[0]
    m, i = 1, 1
    while i < n:
        last = _reach(z, v, n, i, ox, oy, epsilon, scale)
        ex, ey, last, done = _segment(z, v, n, i, last, ox, oy, epsilon, scale)
        if done:
            break
        out_z[m], out_v[m] = ex / scale, ey
        m += 1
        ox, oy, i = ex, ey, last + 1
    return m


@numba.njit(nogil=True, cache=True)
def _reach(z, v, n, i, ox, oy, epsilon, scale):  # type: ignore[no-untyped-def]
    """Last point whose cone still meets those of points i … before it."""
    low, high = -np.pi, np.pi
    for j in range(i, n):
        dx, dy = z[j] * scale - ox, v[j] - oy
        length = np.hypot(dx, dy)
        if length > epsilon:
            angle, spread = np.arctan2(dy, dx), np.arcsin(epsilon / length)
            low, high = max(low, angle - spread), min(high, angle + spread)
            if low > high:
                return j - 1 if j > i else i
    return n - 1


@numba.njit(nogil=True, cache=True)
def _segment(z, v, n, i, last, ox, oy, epsilon, scale):  # type: ignore[no-untyped-def]
    """(end x, end y, last point, finished): the longest segment from (ox, oy) with points i … last within epsilon of it."""
    while last >= i:
        low, high, constrained = -np.pi / 2, np.pi / 2, False
        for j in range(i, last + 1):
            dx, dy = z[j] * scale - ox, v[j] - oy
            length = np.hypot(dx, dy)
            if length > epsilon:
                angle, spread = np.arctan2(dy, dx), np.arcsin(epsilon / length)
                low, high, constrained = max(low, angle - spread), min(high, angle + spread), True
        if not constrained:
            if last == n - 1:
                return ox, oy, last, True
            return z[i] * scale, v[i], i, False
        angle = min(max((low + high) / 2, -np.pi / 2), np.pi / 2)
        cx, cy = np.cos(angle), np.sin(angle)
        along = max((z[last] * scale - ox) * cx + (v[last] - oy) * cy, 0.0)
        ex, ey = ox + along * cx, min(max(oy + along * cy, 0.0), 1.0)
        inside = True
        for j in range(i, last + 1):
            if _distance(z[j] * scale, v[j], ox, oy, ex, ey) > epsilon:
                inside = False
                break
        if inside:
            return ex, ey, last, False
        last -= 1
    return z[i] * scale, v[i], i, False


@numba.njit(inline="always")
def _distance(px, py, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Distance of a point from a segment."""
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    t = 0.0 if length == 0 else min(max(((px - ax) * dx + (py - ay) * dy) / length, 0.0), 1.0)
    return np.hypot(px - ax - t * dx, py - ay - t * dy)
