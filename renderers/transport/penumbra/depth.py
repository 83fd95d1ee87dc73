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
# bytes that a camera needs for each vertex
SEEN = 3 * 8 + 4 * 4
FAR_OUT = 1 << 30
# part of a texel
ROUNDING = 1e-3


@numba.njit(parallel=True, cache=True)
def depth_maps(vertices, triangles, cover, cameras, top, maps, spare, texels, pixels, limit):  # type: ignore[no-untyped-def]
    """Fill maps float32 (N, h, w) with depth D + b_s along each camera's axis, inf where nothing is hit.

    vertices float64 (V, 3), pyramid's frame, of the casters triangles int32 (T, 3). cover float64 (T, 2): opacity, and a shift of
    ranks. cameras (N, CAMERA). top int64 (N,): rows of each camera's window above those of `maps`. spare float32 (2, N, h, w): room
    to work in. texels = c_S; pixels = c_P Δu_P, tangent units; limit: largest b_s, World units (0: plain depth). A triangle of
    opacity α is in the maps whose rank + shift, less its whole part, is below α: in α N of them (stochastic opacity). Every thread
    needs SEEN bytes a vertex more.
    """
    for i in numba.prange(len(cameras)):
        first, slope, second = maps[i], spare[0, i], spare[1, i]
        first.fill(np.inf)
        second.fill(np.inf)
        seen, texel = np.empty((len(vertices), 3)), np.empty((len(vertices), 4), np.int32)
        _see(vertices, cameras[i], seen, texel)
        left, right, upper, lower = 0, first.shape[1] - 1, top[i], top[i] + first.shape[0] - 1
        for t in range(len(triangles)):
            j, k, m = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            y0 = max(min(texel[j, 2], texel[k, 2], texel[m, 2]), upper)
            y1 = min(max(texel[j, 3], texel[k, 3], texel[m, 3]), lower)
            if y0 > y1:
                continue
            x0 = max(min(texel[j, 0], texel[k, 0], texel[m, 0]), left)
            x1 = min(max(texel[j, 1], texel[k, 1], texel[m, 1]), right)
            if x0 > x1 or (seen[j, 2] <= FRONT and seen[k, 2] <= FRONT and seen[m, 2] <= FRONT):
                continue
            if cover[t, 0] < 1 and (cameras[i, RANK] + cover[t, 1]) % 1.0 >= cover[t, 0]:
                continue
            p, q, r = seen[j], seen[k], seen[m]
            _fill((x0, x1 + 1), (y0, y1 + 1), p, q, r, cameras[i], top[i], first, second, slope, texels, pixels)
        if limit > 0:
            _add_bias(first, second, slope, limit)


@numba.njit(nogil=True, cache=True)
def _see(vertices, camera, seen, texel):  # type: ignore[no-untyped-def]
    """Vertices (V, 3) in the camera's frame, and the texels whose centres are around each, int32 (V, 4): the first column not left
    of it, the last one not right of it, and the same of rows.

    Those of a triangle's corners together bound the texels that it may cover. A corner at the camera's plane or behind bounds none.
    """
    for k in range(len(vertices)):
        x, y, z = vertices[k, 0] - camera[S], vertices[k, 1] - camera[S + 1], vertices[k, 2] - camera[S + 2]
        for r in range(3):
            seen[k, r] = camera[3 * r] * x + camera[3 * r + 1] * y + camera[3 * r + 2] * z
        ahead = seen[k, 2]
        if ahead <= FRONT:
            texel[k, 0] = texel[k, 2] = -FAR_OUT
            texel[k, 1] = texel[k, 3] = FAR_OUT
            continue
        # far out of the window a float may not fit an integer
        across = min(max((seen[k, 0] / ahead - camera[U0]) / camera[DU] - 0.5, -FAR_OUT), FAR_OUT)
        down = min(max((seen[k, 1] / ahead - camera[V0]) / camera[DV] - 0.5, -FAR_OUT), FAR_OUT)
        texel[k, 0], texel[k, 1] = np.ceil(across - ROUNDING), np.floor(across + ROUNDING)
        texel[k, 2], texel[k, 3] = np.ceil(down - ROUNDING), np.floor(down + ROUNDING)


@numba.njit(inline="always")
def _cross(a, b):  # type: ignore[no-untyped-def]
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(inline="always")
def _fill(columns, rows, p, q, r, camera, top, depth, second, slope, texels, pixels):  # type: ignore[no-untyped-def]
    """One triangle with corners p, q, r in the camera's frame into the texels of some columns and rows."""
    a0, a1, a2 = _cross(q, r)
    b0, b1, b2 = _cross(r, p)
    c0, c1, c2 = _cross(p, q)
    det = p[0] * a0 + p[1] * a1 + p[2] * a2
    if det == 0:
        return
    if det < 0:
        det, a0, a1, a2, b0, b1, b2, c0, c1, c2 = -det, -a0, -a1, -a2, -b0, -b1, -b2, -c0, -c1, -c2
    du, dv = camera[DU], camera[DV]
    nx, ny, nz = a0 + b0 + c0, a1 + b1 + c1, a2 + b2 + c2
    # depth of the camera over the apex, for pixels of the pyramid seen from this camera
    ahead = camera[6] * camera[S] + camera[7] * camera[S + 1] + camera[8] * camera[S + 2]
    for y in range(rows[0], rows[1]):
        v = camera[V0] + (y + 0.5) * dv
        av, bv, cv, nv = a1 * v + a2, b1 * v + b2, c1 * v + c2, ny * v + nz
        for x in range(columns[0], columns[1]):
            u = camera[U0] + (x + 0.5) * du
            if a0 * u + av < 0 or b0 * u + bv < 0 or c0 * u + cv < 0:
                continue
            across = nx * u + nv
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
