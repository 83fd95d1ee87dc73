"""Moment shadow maps with soft shadows (Peters & Klein 2015; Peters et al. 2017): four moments of depth, summed over any window.

A map holds z, z², z³, z⁴ of depth scaled to [-1, 1], as a summed-area table: the mean of a window is four reads whatever its size.
Of all distributions with these moments the one that hides a receiver at z_f least has three depths, z_f and the roots of

    c_3 z² + c_2 z + c_1 = 0,        B c = (1, z_f, z_f²)ᵀ,        B = (b_{i+j}), i, j = 0, 1, 2

Their weights before z_f are the shadow, never more than the true one; the mean of those depths is the blocker's. As in
percentage-closer soft shadows, a first window (what the light covers of the near plane) finds the blocker, a second as wide as its
penumbra the share.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.cameras import DU, DV, U0, V0, S
from renderers.transport.penumbra.filtered import Kernel
from renderers.transport.penumbra.pyramid import Pyramid

# a blocker's share of a window this small has no depth to speak of: the receiver's own stands in (Peters et al. 2017)
FAINT = 1e-2
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


def summed_moments(pyramid: Pyramid, cameras: F64, maps: F32) -> F64:
    """Summed-area tables (N, h + 1, w + 1, 4) of the moments of maps float32 (N, h, w), depth scaled by the pyramid's range."""
    z = scaled(np.minimum(maps.astype(np.float64), pyramid.far), pyramid)
    tables = np.zeros((maps.shape[0], maps.shape[1] + 1, maps.shape[2] + 1, 4))
    for power in range(4):
        tables[:, 1:, 1:, power] = (z ** (power + 1)).cumsum(axis=1).cumsum(axis=2)
    return tables


def scaled(depth: F64, pyramid: Pyramid) -> F64:
    """Depths 0 … far to [-1, 1]."""
    return np.asarray(2 * depth / pyramid.far - 1)


def moment_soft(bias: float, moment_bias: float) -> Kernel:
    """Reads hidden shares from `summed_moments`. bias: of the receiver's depth, World units. moment_bias: share of a distribution
    that is as uncertain as can be, mixed in against rounding.
    """

    def kernel(pyramid: Pyramid, cameras: F64, maps: F64, points: F64, normals: F64, extent: F64) -> F32:
        out = np.zeros(len(points), np.float32)
        moment_shares(points, extent, cameras[0], maps[0], pyramid.near, pyramid.far, bias, moment_bias, out)
        return out

    return kernel


@numba.njit(inline="always")
def _corner(table, x, y, power):  # type: ignore[no-untyped-def]
    """The table between its entries, bilinearly."""
    i, j = min(int(x), table.shape[1] - 2), min(int(y), table.shape[0] - 2)
    a, b = x - i, y - j
    upper = table[j, i, power] * (1 - a) + table[j, i + 1, power] * a
    lower = table[j + 1, i, power] * (1 - a) + table[j + 1, i + 1, power] * a
    return upper * (1 - b) + lower * b


@numba.njit(inline="always")
def _mean(table, x0, x1, y0, y1, moment_bias):  # type: ignore[no-untyped-def]
    """Moments (4) of the window in texel coordinates, cut to the map, with the moment bias."""
    w, h = table.shape[1] - 1.0, table.shape[0] - 1.0
    x0, x1, y0, y1 = max(x0, 0.0), min(x1, w), max(y0, 0.0), min(y1, h)
    area = (x1 - x0) * (y1 - y0)
    if x1 <= x0 or y1 <= y0:
        return 1.0, 1.0, 1.0, 1.0
    b = np.empty(4)
    for k in range(4):
        total = _corner(table, x1, y1, k) - _corner(table, x0, y1, k) - _corner(table, x1, y0, k) + _corner(table, x0, y0, k)
        b[k] = (1 - moment_bias) * total / area
    # the moments of four equal parts at ±1 and ±1/2, in sum as far from certainty as depths in [-1, 1] can be (Peters & Klein 2015)
    return b[0], b[1] + moment_bias * 0.625, b[2], b[3] + moment_bias * 0.53125


@numba.njit(inline="always")
def least_shadow(b1, b2, b3, b4, z):  # type: ignore[no-untyped-def]
    """(share, mean depth) of what is before z in the distribution of these moments that has the least there."""
    # Cholesky B = L D Lᵀ
    d2 = b2 - b1 * b1
    l32 = (b3 - b1 * b2) / d2
    d3 = b4 - b2 * b2 - l32 * l32 * d2
    y2, y3 = z - b1, 0.0
    y3 = z * z - b2 - l32 * y2
    c3 = y3 / d3
    c2 = y2 / d2 - l32 * c3
    c1 = 1 - b1 * c2 - b2 * c3
    if abs(c3) < 1e-12:
        return 0.0, z
    p, q = c2 / c3, c1 / c3
    root = np.sqrt(max(p * p / 4 - q, 0.0))
    first, second = -p / 2 - root, -p / 2 + root
    share, total = 0.0, 0.0
    if first < z:
        w = (z * second - b1 * (z + second) + b2) / ((first - z) * (first - second))
        share, total = share + w, total + w * first
    if second < z:
        w = (z * first - b1 * (z + first) + b2) / ((second - z) * (second - first))
        share, total = share + w, total + w * second
    share = min(max(share, 0.0), 1.0)
    return share, (total / share if share > 0 else z)


@numba.njit(parallel=True, cache=True)
def moment_shares(points, extent, camera, table, near, far, bias, moment_bias, out):  # type: ignore[no-untyped-def]
    """out float32 (P,): hidden share of points float64 (P, 3), pyramid's frame; extent (2,): half size of the light; table of one
    map.
    """
    for i in numba.prange(len(points)):
        z = points[i, 2] - camera[S + 2]
        at = 2 * (z - bias) / far - 1
        x = ((points[i, 0] - camera[S]) / z - camera[U0]) / camera[DU]
        y = ((points[i, 1] - camera[S + 1]) / z - camera[V0]) / camera[DV]
        reach = max(1 / near - 1 / z, 0.0)
        rx, ry = max(extent[0] * reach / camera[DU], 0.5), max(extent[1] * reach / camera[DV], 0.5)
        b1, b2, b3, b4 = _mean(table, x - rx, x + rx, y - ry, y + ry, moment_bias)
        share, mean = least_shadow(b1, b2, b3, b4, at)
        if share <= 0:
            out[i] = 0
            continue
        mean = (share * mean + FAINT * at) / (share + FAINT)
        blocker = min(max((mean + 1) / 2 * far, near / 2), z)
        wide = (z - blocker) / (blocker * z)
        rx, ry = max(extent[0] * wide / camera[DU], 0.5), max(extent[1] * wide / camera[DV], 0.5)
        b1, b2, b3, b4 = _mean(table, x - rx, x + rx, y - ry, y + ry, moment_bias)
        out[i] = least_shadow(b1, b2, b3, b4, at)[0]
