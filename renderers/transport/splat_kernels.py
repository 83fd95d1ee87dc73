"""numba kernels that splat virtual lights with bounded supports pair by pair: any BRDF, shadow rays. Twin of `cuts.glsl`.

`splat_lambert` is the fast way for Lambertian receivers without occlusion. One pair adds

    w(α) · max(0, n_x·v) max(0, -n_y·v) / (r² max(ε_b, r²)) · I,      v = y - x,  r² = v·v,  α = r³ / (-n_y·v)

A light skips a block of tiles, and then a tile, that it brings nothing to (`supports.misses`). What is left is added in the order
of the lights, and only blocks are spread over threads: the same bytes at any thread count.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.scene.world import LAMBERT
from renderers.transport.cuts import HAT, RIDGE, TWO_HATS
from renderers.transport.kernels import SAFE_R2, ZERO, shade
from renderers.transport.supports import INNER, OUTER, bound_at, hat, misses, ridge, roulette
from renderers.transport.tiles import AREA


@numba.njit(inline="always")
def light_at(lights, j):  # type: ignore[no-untyped-def]
    """Position, normal and support of light j, 16 numbers: loaded once, outside the loop over pixels, which then uses vectors."""
    return (
        lights[0, j], lights[1, j], lights[2, j], lights[3, j], lights[4, j], lights[5, j],
        lights[11, j], lights[12, j], lights[13, j], lights[14, j], lights[15, j],
        lights[16, j], lights[17, j], lights[18, j], lights[19, j], lights[20, j],
    )  # fmt: skip


@numba.njit(inline="always")
def transfer(family, px, py, pz, nx, ny, nz, light, eps_b):  # type: ignore[no-untyped-def]
    """w · G_b of one receiver and light (see `light_at`)."""
    x, y, z, a, b, c, s0, s1, s2, s3, s4, s5, s6, s7, s8, s9 = light
    vx, vy, vz = x - px, y - py, z - pz
    r2 = vx * vx + vy * vy + vz * vz
    cx = max(ZERO, nx * vx + ny * vy + nz * vz)
    cy = max(ZERO, -(a * vx + b * vy + c * vz))
    safe = max(r2, SAFE_R2)
    cube = safe * np.sqrt(safe)
    if family == HAT:
        weighted = hat(cube, cy, s0, s1, s2, s3)
    elif family == TWO_HATS:
        weighted = hat(cube, cy, s0, s1, s2, s3) * s8 + hat(cube, cy, s4, s5, s6, s7) * s9
    elif family == RIDGE:
        weighted = ridge(cube, cy, s0, s1, s2)
    else:
        weighted = roulette(cube, cy, s0, s1)
    g = cx * weighted / (safe * max(eps_b, safe))
    return g if r2 > SAFE_R2 else ZERO


@numba.njit(inline="always")
def _misses(bound, lights, j):  # type: ignore[no-untyped-def]
    """`misses` of light j, a column of (9 + PARAMETERS, L)."""
    return misses(
        bound,
        lights[0, j],
        lights[1, j],
        lights[2, j],
        lights[3, j],
        lights[4, j],
        lights[5, j],
        lights[INNER, j],
        lights[OUTER, j],
    )


@numba.njit(nogil=True, cache=True)
def lit_pairs(family, receivers, geometric, tile_bounds, block_bound, lights, j, eps_b, offset, pairs, values, origins, directions):  # type: ignore[no-untyped-def]
    """Fill lit pairs (tile, place, light), w G_b and shadow rays from light j on, until the next light might not fit.

    receivers (T, 6, AREA), geometric (T, 3, AREA): the tiles of one block. Rays start `offset` off the receiver and end `offset`
    off the light, both along geometric normals; directions are unnormalised: distance 1 is the light. Returns the number of pairs,
    of pairs evaluated, and the light to go on with.
    """
    count, tested = 0, 0
    while j < lights.shape[1] and count + len(receivers) * AREA <= len(pairs):
        if not _misses(bound_at(block_bound, 0), lights, j):
            for t in range(len(receivers)):
                if not _misses(bound_at(tile_bounds, t), lights, j):
                    tested += AREA
                    count = _lit_of_tile(
                        family, receivers[t], geometric[t], t, lights, j, eps_b, offset, count, pairs, values, origins, directions
                    )
        j += 1
    return count, tested, j


@numba.njit(nogil=True, cache=True)
def _lit_of_tile(family, here, plane, t, lights, j, eps_b, offset, count, pairs, values, origins, directions):  # type: ignore[no-untyped-def]
    light = light_at(lights, j)
    for i in range(AREA):
        g = transfer(family, here[0, i], here[1, i], here[2, i], here[3, i], here[4, i], here[5, i], light, eps_b)
        if g <= ZERO:
            continue
        outside = ZERO
        for c in range(3):
            outside += plane[c, i] * (lights[c, j] - here[c, i])
        side = offset if outside >= ZERO else -offset
        for c in range(3):
            begin = here[c, i] + side * plane[c, i]
            origins[count, c] = begin
            directions[count, c] = lights[c, j] + offset * lights[3 + c, j] - begin
        pairs[count, 0], pairs[count, 1], pairs[count, 2] = t, i, j
        values[count] = g
        count += 1
    return count


@numba.njit(nogil=True, cache=True)
def add_pairs(pixel, position, normal, view, kind, base, specular, exponent, metallic, alpha, lights, pairs, values, blocked, out):  # type: ignore[no-untyped-def]
    """out (P, 3) float64 += f · value · I over the pairs that aren't blocked; pixel (T, AREA) indexes the rows of all others."""
    weight = np.empty(3)
    for k in range(len(pairs)):
        if blocked[k]:
            continue
        i, j = pixel[pairs[k, 0], pairs[k, 1]], pairs[k, 2]
        for c in range(3):
            weight[c] = values[k] * lights[6 + c, j]
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
