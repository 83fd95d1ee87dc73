"""Shadow maps on the CPU: depth of the first surface at every texel centre, all maps in parallel.

Each triangle is tested in homogeneous coordinates (Olano & Greer 1997): with corners p_i in the camera's frame and the texel's ray
d = (u, v, 1), d hits it where (p_j × p_k)·d has one sign for all three edges, at depth det(p) / (n·d). No clipping is needed, so
what lies before the pyramid's near plane still casts, as with a depth clamp. Shared edges leave no gap: both sides compute one
product.

A map stores D + b_s, b_s the bias that this texel's own plane needs (St-Amour 2004 adds a bias at construction without a formula).
A plane does not shadow itself if

    b_s ≥ |∂Z/∂u| (c_S Δu_S + c_P Δu_P) + |∂Z/∂v| (c_S Δv_S + c_P Δv_P)

(to first order; b_s is the exact difference of the plane's depths) because a map's texel stands for points up to half a texel away
(c_S = 1/2, midpoint walk 3/2) and a lookup blends functions up to one pixel of the pyramid away (c_P = 1 bilinear, 1/2 nearest). It
is at most half the way to the second surface of the texel (midpoint shadow maps, Woo 1992): next to a solid's side the bias only
reaches into the solid, and what a thin sheet shades stays shaded.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.penumbra.cameras import DU, DV, RANK, U0, V0, S

FRONT = 1e-7


@numba.njit(parallel=True, cache=True)
def depth_maps(corners, cover, cameras, top, maps, spare, texels, pixels, limit):  # type: ignore[no-untyped-def]
    """Fill maps float32 (N, h, w) with depth D + b_s along each camera's axis, inf where nothing is hit.

    corners float64 (T, 3, 3): casters, pyramid's frame. cover float64 (T, 2): opacity, and a shift of ranks. cameras (N, CAMERA).
    top int64 (N,): rows of each camera's window above those of `maps`. spare float32 (2, N, h, w): room to work in. texels = c_S;
    pixels = c_P Δu_P, tangent units; limit: largest b_s, World units (0: plain depth). A triangle of opacity α is in the maps whose
    rank + shift, less its whole part, is below α: in α N of them (stochastic opacity).
    """
    for i in numba.prange(len(cameras)):
        first, slope, second = maps[i], spare[0, i], spare[1, i]
        first.fill(np.inf)
        slope.fill(0.0)
        second.fill(np.inf)
        p, e = np.empty((3, 3)), np.empty((3, 3))
        for t in range(len(corners)):
            if (cameras[i, RANK] + cover[t, 1]) % 1.0 >= cover[t, 0]:
                continue
            _rasterize(corners[t], cameras[i], top[i], first, second, slope, texels, pixels, p, e)
        if limit > 0:
            _add_bias(first, second, slope, limit)


@numba.njit(nogil=True, cache=True)
def _rasterize(corners, camera, top, depth, second, slope, texels, pixels, p, e):  # type: ignore[no-untyped-def]
    """One triangle into one map; p, e (3, 3): room for its corners in the camera's frame, and its edges."""
    for k in range(3):
        x, y, z = corners[k, 0] - camera[S], corners[k, 1] - camera[S + 1], corners[k, 2] - camera[S + 2]
        for r in range(3):
            p[k, r] = camera[3 * r] * x + camera[3 * r + 1] * y + camera[3 * r + 2] * z
    if p[0, 2] <= FRONT and p[1, 2] <= FRONT and p[2, 2] <= FRONT:
        return
    rows = _bounds(p, 1, camera[V0], camera[DV], top, depth.shape[0])
    if rows[0] >= rows[1]:
        return
    columns = _bounds(p, 0, camera[U0], camera[DU], 0, depth.shape[1])
    if columns[0] >= columns[1]:
        return
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        e[k, 0] = p[a, 1] * p[b, 2] - p[a, 2] * p[b, 1]
        e[k, 1] = p[a, 2] * p[b, 0] - p[a, 0] * p[b, 2]
        e[k, 2] = p[a, 0] * p[b, 1] - p[a, 1] * p[b, 0]
    det = p[0, 0] * e[0, 0] + p[0, 1] * e[0, 1] + p[0, 2] * e[0, 2]
    if det == 0:
        return
    if det < 0:
        det = -det
        e *= -1.0
    _fill(columns, rows, e, det, camera, top, depth, second, slope, texels, pixels)


@numba.njit(inline="always")
def _bounds(p, axis, start, step, base, size):  # type: ignore[no-untyped-def]
    """Range of texels, of those base … base + size - 1, whose centres can lie on the triangle along one axis; all of them where it
    reaches the camera's plane.
    """
    if p[0, 2] <= FRONT or p[1, 2] <= FRONT or p[2, 2] <= FRONT:
        return base, base + size
    a, b, c = p[0, axis] / p[0, 2], p[1, axis] / p[1, 2], p[2, axis] / p[2, 2]
    low, high = (min(a, b, c) - start) / step - 0.5, (max(a, b, c) - start) / step - 0.5
    # a thousandth of a texel for rounding; min and max before int: far out of the window a float does not fit one
    end = base + size
    return int(np.ceil(min(max(low - 1e-3, float(base)), float(end)))), int(
        np.floor(max(min(high + 1e-3, end - 1.0), base - 1.0))
    ) + 1


@numba.njit(inline="always")
def _fill(columns, rows, e, det, camera, top, depth, second, slope, texels, pixels):  # type: ignore[no-untyped-def]
    du, dv = camera[DU], camera[DV]
    nx, ny, nz = e[0, 0] + e[1, 0] + e[2, 0], e[0, 1] + e[1, 1] + e[2, 1], e[0, 2] + e[1, 2] + e[2, 2]
    # depth of the camera over the apex, for pixels of the pyramid seen from this camera
    ahead = camera[6] * camera[S] + camera[7] * camera[S + 1] + camera[8] * camera[S + 2]
    for y in range(rows[0], rows[1]):
        v = camera[V0] + (y + 0.5) * dv
        c0, c1, c2 = e[0, 1] * v + e[0, 2], e[1, 1] * v + e[1, 2], e[2, 1] * v + e[2, 2]
        for x in range(columns[0], columns[1]):
            u = camera[U0] + (x + 0.5) * du
            if e[0, 0] * u + c0 < 0 or e[1, 0] * u + c1 < 0 or e[2, 0] * u + c2 < 0:
                continue
            across = nx * u + ny * v + nz
            if across <= 0:
                continue
            z = np.float32(det / across)
            if z < depth[y - top, x]:
                second[y - top, x], depth[y - top, x] = depth[y - top, x], z
                wide = pixels * max((z + ahead) / z, 0.0)
                lean = abs(nx) * (texels * du + wide) + abs(ny) * (texels * dv + wide)
                slope[y - top, x] = z * lean / (across - lean) if across > lean else np.inf
            elif z < second[y - top, x]:
                second[y - top, x] = z


@numba.njit(nogil=True, cache=True)
def _add_bias(first, second, slope, limit):  # type: ignore[no-untyped-def]
    """first + b_s, at most half way to the second surface."""
    for y in range(first.shape[0]):
        for x in range(first.shape[1]):
            if first[y, x] < np.inf:
                first[y, x] += min(slope[y, x], limit, (second[y, x] - first[y, x]) / 2)
