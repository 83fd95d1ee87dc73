"""numba kernels of the VPL gather. Lights are rows of one float32 array (9, L): x, y, z, normal, intensity (structure of arrays).

Each pixel adds up its lights one after another (float32 inside a block of BLOCK lights, float64 across blocks), and only pixels are
spread over threads: the same bytes at any thread count. Vector lanes are pixels, so no sum is taken in another order than written,
and what is fused is said (`fused`): the same bytes whatever a compiler makes of it, for another CPU or on optimising once more.

One pair:  G_b = max(0, n_x·v) max(0, -n_y·v) / (r² max(ε_b, r²)),  v = y - x,  r² = v·v  (the two cosines still unnormalised).
Pairs closer than SAFE_R2 (1e-9 of the world's size, under float32's resolution of a coordinate) give 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import GGX_KIND, LAMBERT, PHONG
from renderers.transport.brdf import ggx_lobe_scalar, phong_lobe_scalar, schlick_scalar
from renderers.transport.fused import fma

BLOCK = 128
TILE = 256
ROW = TILE + 48  # rows at powers of two would share the sets of the cache, and stores would seem to hit loads of other rows
SAFE_R2 = np.float32(1e-18)
ZERO = np.float32(0)
ONE = np.float32(1)


class Receivers(NamedTuple):
    """What kernels read of P pixels: position, normal (P, 3); to_eye float64 (P, 3), unit; the fields of `Materials`.

    Flat, since numba's parallel loops take no tuples inside tuples.
    """

    position: NDArray[np.floating]
    normal: NDArray[np.floating]
    to_eye: NDArray[np.float64]
    kind: NDArray[np.int32]
    base: NDArray[np.float64]
    specular: NDArray[np.float64]
    exponent: NDArray[np.float64]
    metallic: NDArray[np.float64]
    alpha: NDArray[np.float64]


@numba.njit(inline="always")
def _geometry(px, py, pz, nx, ny, nz, lights, j, eps_b):  # type: ignore[no-untyped-def]
    """G_b of one pixel and light; lights is the (9, L) array."""
    vx, vy, vz = lights[0, j] - px, lights[1, j] - py, lights[2, j] - pz
    r2 = vx * vx + vy * vy + vz * vz
    cx = max(ZERO, nx * vx + ny * vy + nz * vz)
    cy = max(ZERO, -(lights[3, j] * vx + lights[4, j] * vy + lights[5, j] * vz))
    safe = max(r2, SAFE_R2)
    return cx * cy / (safe * max(eps_b, safe)) if r2 > SAFE_R2 else ZERO


@numba.njit(error_model="numpy")
def _add_light(tile, lights, j, eps_b):  # type: ignore[no-untyped-def]
    """Add light j to a tile: nine rows of TILE float32, ROW apart: position, normal, sum of G_b I."""
    x, y, z = lights[0, j], lights[1, j], lights[2, j]
    a, b, c = -lights[3, j], -lights[4, j], -lights[5, j]
    red, green, blue = lights[6, j], lights[7, j], lights[8, j]
    for i in range(TILE):
        vx, vy, vz = x - tile[i], y - tile[ROW + i], z - tile[2 * ROW + i]
        r2 = fma(vx, vx, fma(vy, vy, vz * vz))
        cx = max(ZERO, fma(tile[3 * ROW + i], vx, fma(tile[4 * ROW + i], vy, tile[5 * ROW + i] * vz)))
        cy = max(ZERO, fma(a, vx, fma(b, vy, c * vz)))
        g = cx * cy / (r2 * max(eps_b, r2))
        g = g if r2 > SAFE_R2 else ZERO
        tile[6 * ROW + i] = fma(g, red, tile[6 * ROW + i])
        tile[7 * ROW + i] = fma(g, green, tile[7 * ROW + i])
        tile[8 * ROW + i] = fma(g, blue, tile[8 * ROW + i])


@numba.njit
def _fold(sums, tile):  # type: ignore[no-untyped-def]
    """Add a tile's sums to those in float64, (3 · ROW,), and begin them anew."""
    for i in range(3 * ROW):
        sums[i] += tile[6 * ROW + i]
    tile[6 * ROW :] = ZERO


@numba.njit(parallel=True, cache=True)
def gather_lambert(position, normal, lights, eps_b, out):  # type: ignore[no-untyped-def]
    """out (P, 3) float64 += Σ G_b I; position, normal float32 (P, 3). The caller multiplies by ρ/π."""
    for first in numba.prange((len(position) + TILE - 1) // TILE):
        here = position[first * TILE : (first + 1) * TILE], normal[first * TILE : (first + 1) * TILE]
        tile, sums = np.zeros(9 * ROW, np.float32), np.zeros(3 * ROW)
        for i in range(len(here[0])):
            for c in range(3):
                tile[c * ROW + i], tile[(3 + c) * ROW + i] = here[0][i, c], here[1][i, c]
        for j in range(lights.shape[1]):
            _add_light(tile, lights, j, eps_b)
            if (j + 1) % BLOCK == 0:
                _fold(sums, tile)
        _fold(sums, tile)
        for i in range(len(here[0])):
            for c in range(3):
                out[first * TILE + i, c] += sums[c * ROW + i]


@numba.njit(inline="always")
def shade(kind, base, specular, exponent, metallic, alpha, n, v, light, weight, out):  # type: ignore[no-untyped-def]
    """out (3,) += f(light, v) · weight (3,); n, v, light: unit tuples of float64."""
    nl = n[0] * light[0] + n[1] * light[1] + n[2] * light[2]
    nv = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
    if nl <= 0 or nv <= 0:
        return
    lobe, fresnel = 0.0, 0.0
    if kind == PHONG:
        lv = light[0] * v[0] + light[1] * v[1] + light[2] * v[2]
        lobe = phong_lobe_scalar(exponent, 2 * nl * nv - lv)
    elif kind == GGX_KIND:
        hx, hy, hz = light[0] + v[0], light[1] + v[1], light[2] + v[2]
        length = max(np.sqrt(hx * hx + hy * hy + hz * hz), 1e-12)
        hx, hy, hz = hx / length, hy / length, hz / length
        sx, sy, sz = n[1] * hz - n[2] * hy, n[2] * hx - n[0] * hz, n[0] * hy - n[1] * hx
        nh = n[0] * hx + n[1] * hy + n[2] * hz
        lobe = ggx_lobe_scalar(alpha, nl, nv, nh, sx * sx + sy * sy + sz * sz)
        fresnel = schlick_scalar(v[0] * hx + v[1] * hy + v[2] * hz)
    for c in range(3):
        if kind == GGX_KIND:
            f0 = 0.04 * (1 - metallic) + base[c] * metallic
            f = f0 + (1 - f0) * fresnel
            value = (1 - f) * base[c] * (1 - metallic) / np.pi + f * lobe
        else:
            value = base[c] / np.pi + specular[c] * lobe
        out[c] += value * weight[c]


@numba.njit(inline="always")
def reflect(pixels, i, d, r2, weight, out):  # type: ignore[no-untyped-def]
    """out[i] += f · weight (3,) at pixel i of `Receivers`, of light from the direction d, a tuple of length √r2 > 0."""
    if pixels.kind[i] == LAMBERT:
        for c in range(3):
            out[i, c] += pixels.base[i, c] / np.pi * weight[c]
        return
    r = np.sqrt(float(r2))
    n = (float(pixels.normal[i, 0]), float(pixels.normal[i, 1]), float(pixels.normal[i, 2]))
    v = (pixels.to_eye[i, 0], pixels.to_eye[i, 1], pixels.to_eye[i, 2])
    shade(
        pixels.kind[i], pixels.base[i], pixels.specular[i], pixels.exponent[i], pixels.metallic[i],
        pixels.alpha[i], n, v, (float(d[0]) / r, float(d[1]) / r, float(d[2]) / r), weight, out[i],
    )  # fmt: skip


@numba.njit(parallel=True, cache=True)
def gather_general(position, normal, view, kind, base, specular, exponent, metallic, alpha, lights, eps_b, out):  # type: ignore[no-untyped-def]
    """out (P, 3) float64 += Σ f G_b I for any BRDF; per-pixel parameters as in `brdf.Materials`, view float64 (P, 3) unit."""
    for i in numba.prange(len(position)):
        n = (float(normal[i, 0]), float(normal[i, 1]), float(normal[i, 2]))
        v = (view[i, 0], view[i, 1], view[i, 2])
        weight = np.empty(3)
        for j in range(lights.shape[1]):
            g = _geometry(
                position[i, 0], position[i, 1], position[i, 2], normal[i, 0], normal[i, 1], normal[i, 2], lights, j, eps_b
            )
            if g > ZERO:
                dx, dy, dz = (
                    float(lights[0, j] - position[i, 0]),
                    float(lights[1, j] - position[i, 1]),
                    float(lights[2, j] - position[i, 2]),
                )
                r = np.sqrt(dx * dx + dy * dy + dz * dz)
                for c in range(3):
                    weight[c] = g * lights[6 + c, j]
                shade(
                    kind[i], base[i], specular[i], exponent[i], metallic[i], alpha[i],
                    n, v, (dx / r, dy / r, dz / r), weight, out[i],
                )  # fmt: skip


@numba.njit(nogil=True, cache=True)
def facing_pairs(position, normal, geometric, lights, first, last, offset, pairs, origins, directions):  # type: ignore[no-untyped-def]
    """Fill pairs (pixel, light) with G_b > 0 and their shadow rays; returns how many.

    Rays start `offset` off the receiver and end `offset` off the light, both along geometric normals; directions are unnormalised:
    distance 1 is the light. Order: light by light, pixels in order.
    """
    count = 0
    for j in range(first, last):
        for i in range(len(position)):
            vx, vy, vz = lights[0, j] - position[i, 0], lights[1, j] - position[i, 1], lights[2, j] - position[i, 2]
            if vx * vx + vy * vy + vz * vz <= SAFE_R2:
                continue
            if normal[i, 0] * vx + normal[i, 1] * vy + normal[i, 2] * vz <= ZERO:
                continue
            if lights[3, j] * vx + lights[4, j] * vy + lights[5, j] * vz >= ZERO:
                continue
            outside = geometric[i, 0] * vx + geometric[i, 1] * vy + geometric[i, 2] * vz >= ZERO
            side = offset if outside else -offset
            for c in range(3):
                start = position[i, c] + side * geometric[i, c]
                origins[count, c] = start
                directions[count, c] = lights[c, j] + offset * lights[3 + c, j] - start
            pairs[count, 0], pairs[count, 1] = i, j
            count += 1
    return count


@numba.njit(nogil=True, cache=True)
def add_visible(position, normal, view, kind, base, specular, exponent, metallic, alpha, lights, eps_b, pairs, blocked, out):  # type: ignore[no-untyped-def]
    """out (P, 3) float64 += f G_b I over the pairs that aren't blocked; arrays as in `gather_general`."""
    weight = np.empty(3)
    for k in range(len(pairs)):
        if blocked[k]:
            continue
        i, j = pairs[k, 0], pairs[k, 1]
        g = _geometry(position[i, 0], position[i, 1], position[i, 2], normal[i, 0], normal[i, 1], normal[i, 2], lights, j, eps_b)
        for c in range(3):
            weight[c] = g * lights[6 + c, j]
        if kind[i] == LAMBERT:
            for c in range(3):
                out[i, c] += base[i, c] / np.pi * weight[c]
            continue
        dx, dy, dz = (
            float(lights[0, j] - position[i, 0]),
            float(lights[1, j] - position[i, 1]),
            float(lights[2, j] - position[i, 2]),
        )
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        n = (float(normal[i, 0]), float(normal[i, 1]), float(normal[i, 2]))
        v = (view[i, 0], view[i, 1], view[i, 2])
        shade(
            kind[i], base[i], specular[i], exponent[i], metallic[i], alpha[i],
            n, v, (dx / r, dy / r, dz / r), weight, out[i],
        )  # fmt: skip
