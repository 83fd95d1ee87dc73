"""numba kernels that add radiance records to the pixels inside their zones. Tiles and weights are those of `splat_kernels`.

pixels: position, normal float32 (P, 3), tangents (P, 2, 3), coefficients (P, 3, n²); records: `glossy.RadianceColumns`; table:
`lune.LuneTable` of turns about y. A pixel adds its records in their order, blocks of pixels are spread over threads: the same bytes
at any number of threads.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.caching.splat_kernels import tiles_reached, weight_at
from renderers.transport.fused import dot, fma
from renderers.transport.hemispherical.lune import GRADING, QUARTER

SAME = 1e-4  # largest entry of R - 1 that counts as one frame
UPRIGHT = 1e-3  # tilt in radians under which only the turn about the normal is applied


@numba.njit(parallel=True, cache=True)
def splat_radiance(pixels, tiles, records, table, a, kind, sums, work):  # type: ignore[no-untyped-def]
    """sums (P, 4) += (w·L, w); work (B, 2) int64: pairs of record and pixel, and those that needed a turn."""
    points, normals, tangents, brdf = pixels
    functions = brdf.shape[2]
    for b in numba.prange(len(tiles.first) - 1):
        touched, turned = 0, 0
        light, scratch = np.empty((3, functions), np.float32), np.empty((3, functions), np.float32)
        rotation, reached = np.empty((3, 3)), np.empty(tiles.first[b + 1] - tiles.first[b], np.int64)
        for k in range(len(records.position)):
            position, normal, radius = records.position[k], records.normal[k], records.radius[k]
            for t in tiles_reached(tiles, b, b + 1, position, normal, radius, a, reached):
                for i in tiles.pixel[t]:
                    if i < 0:
                        continue
                    w = weight_at(kind, points[i], normals[i], position, normal, radius, a)
                    if w <= 0:
                        continue
                    touched += 1
                    extrapolate(records.coefficients[k], records.tangents[k], points[i], position, light)
                    if frames_differ(tangents[i], normals[i], records.tangents[k], normal, rotation):
                        turned += 1
                        turn(light, rotation, table, scratch)
                    sums[i, 3] += w
                    for c in range(3):
                        sums[i, c] += w * max(dot(brdf[i, c], light[c]), np.float32(0))
        work[b, 0], work[b, 1] = touched, turned


@numba.njit(cache=True)
def extrapolate(coefficients, axes, point, position, out):  # type: ignore[no-untyped-def]
    """out (3, n²) = λ + δ_x ∂_xλ + δ_y ∂_yλ."""
    x = y = np.float32(0)
    for d in range(3):
        x += (point[d] - position[d]) * axes[0, d]
        y += (point[d] - position[d]) * axes[1, d]
    for c in range(3):
        for i in range(out.shape[1]):
            out[c, i] = coefficients[0, c, i] + x * coefficients[1, c, i] + y * coefficients[2, c, i]


@numba.njit(cache=True)
def frames_differ(axes, normal, record_axes, record_normal, rotation):  # type: ignore[no-untyped-def]
    """rotation (3, 3) = F_p F_kᵀ; whether it is one at all."""
    largest = 0.0
    for r in range(3):
        for s in range(3):
            value = 0.0
            for d in range(3):
                row = axes[r, d] if r < 2 else normal[d]
                column = record_axes[s, d] if s < 2 else record_normal[d]
                value += float(row) * float(column)
            rotation[r, s] = value
            largest = max(largest, abs(value - (1.0 if r == s else 0.0)))
    return largest >= SAME


@numba.njit(cache=True)
def turn(light, rotation, table, scratch):  # type: ignore[no-untyped-def]
    """light (3, n²) turned in place, as `hemispherical.rotation.rotate` does by its tables; tilts are at most a quarter turn."""
    sine = np.hypot(rotation[0, 2], rotation[1, 2])
    beta = np.arctan2(sine, rotation[2, 2])
    if beta < UPRIGHT:
        about_z(light, np.arctan2(rotation[1, 0], rotation[0, 0]))
        return
    about_z(light, np.arctan2(rotation[2, 1], -rotation[2, 0]))
    last = len(table.even) - 1
    beta = min(beta, QUARTER)
    lower = min(int(last * (beta / QUARTER) ** (1 / GRADING)), last - 1)
    start, stop = QUARTER * (lower / last) ** GRADING, QUARTER * ((lower + 1) / last) ** GRADING
    t = np.float32(min(max((beta - start) / (stop - start), 0.0), 1.0))
    tilt(light, table.even[lower], table.even[lower + 1], table.even_rows, t, scratch)
    tilt(light, table.odd[lower], table.odd[lower + 1], table.odd_rows, t, scratch)
    about_z(light, np.arctan2(rotation[1, 2], rotation[0, 2]))


@numba.njit(cache=True)
def about_z(light, angle):  # type: ignore[no-untyped-def]
    """Exact turn about the normal, in place."""
    order = int(np.sqrt(light.shape[1]) + 0.5)
    for m in range(1, order):
        cosine, sine = np.float32(np.cos(m * angle)), np.float32(np.sin(m * angle))
        for degree in range(m, order):
            middle = degree * (degree + 1)
            for c in range(3):
                right, left = light[c, middle + m], light[c, middle - m]
                light[c, middle + m] = cosine * right - sine * left
                light[c, middle - m] = sine * right + cosine * left


@numba.njit(cache=True)
def tilt(light, near, far, rows, t, scratch):  # type: ignore[no-untyped-def]
    """One parity block of a turn about y, in place: light[rows] = (near + t (far - near))ᵀ light[rows]."""
    size = len(rows)
    scratch[:, :size] = 0
    for i in range(size):
        red, green, blue = light[0, rows[i]], light[1, rows[i]], light[2, rows[i]]
        for j in range(size):
            entry = fma(t, far[i, j] - near[i, j], near[i, j])
            scratch[0, j] = fma(entry, red, scratch[0, j])
            scratch[1, j] = fma(entry, green, scratch[1, j])
            scratch[2, j] = fma(entry, blue, scratch[2, j])
    for j in range(size):
        for c in range(3):
            light[c, rows[j]] = scratch[c, j]
