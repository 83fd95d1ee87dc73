"""numba kernels that splat virtual lights with bounded supports on tiles of pixels. Twin of `cuts.glsl`.

Lights are rows of one float32 array (9 + 12, L): position, normal, intensity / density of the level; then the support: inner and
outer coordinate, and its shape (`cuts.Family.parameters`). One pair adds

    w(α) · max(0, n_x·v) max(0, -n_y·v) / (r² max(ε_b, r²)) · I,      v = y - x,  r² = v·v,  α = r³ / (-n_y·v)

A light skips a block of tiles, and then a tile, when bounds of α over the ball around it leave [inner, outer], or when all of it
lies behind the light or turned away from it. What is left is added pixel by pixel in the order of the lights (float32 within BATCH
lights, float64 across batches), and only blocks are spread over threads: the same bytes at any thread count.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.scene.world import LAMBERT
from renderers.transport.cuts import HAT, RIDGE, TWO_HATS
from renderers.transport.kernels import ONE, SAFE_R2, ZERO, shade
from renderers.transport.tiles import AREA

BATCH = 1024
FLAT = np.float32(1e-12)
LN2 = np.float32(np.log(2))
INNER, OUTER = 9, 10


@numba.njit(inline="always")
def misses(ball, lights, j):  # type: ignore[no-untyped-def]
    """Whether light j reaches no receiver of a ball (8,): by the light's side, the receivers' normals, or the support's ends."""
    vx, vy, vz = ball[0] - lights[0, j], ball[1] - lights[1, j], ball[2] - lights[2, j]
    radius = ball[3]
    c = lights[3, j] * vx + lights[4, j] * vy + lights[5, j] * vz
    highest = c + radius
    if highest <= ZERO:
        return True
    d = np.sqrt(vx * vx + vy * vy + vz * vz)
    # bound of n·(y - x): at the centres, + |centre of n| · radius (at most (1 + spread) · radius), + spread · (d + radius)
    facing = -(ball[4] * vx + ball[5] * vy + ball[6] * vz) + radius + ball[7] * (d + radius + radius)
    if facing <= ZERO:
        return True
    near, far = max(ZERO, d - radius), d + radius
    if near * near * near > lights[OUTER, j] * highest:
        return True
    lowest = c - radius
    return lowest > ZERO and far * far * far < lights[INNER, j] * lowest


@numba.njit
def log_of(y):  # type: ignore[no-untyped-def]
    """ln y for float32 y ≥ 1, to 2e-7 of max(1, ln y): exponent, and a series in (m-1)/(m+1). Vectorises, unlike a library call."""
    # y = 2^e · m with m in [√½, √2)
    shifted = np.float32(y).view(np.int32) - np.int32(0x3F3504F3)
    e = shifted >> np.int32(23)
    m = np.int32((shifted & np.int32(0x7FFFFF)) + np.int32(0x3F3504F3)).view(np.float32)
    s = (m - ONE) / (m + ONE)
    q = s * s
    series = ONE + q * (np.float32(1 / 3) + q * (np.float32(1 / 5) + q * (np.float32(1 / 7) + q * np.float32(1 / 9))))
    return np.float32(e) * LN2 + np.float32(2) * s * series


@numba.njit(inline="always")
def hat(cube, cy, low, rise, high, fall):  # type: ignore[no-untyped-def]
    """cy · clip(min((α - low) · rise, (high - α) · fall), 0, 1) with α = cube / cy, without the division."""
    return max(ZERO, min(cy, min((cube - low * cy) * rise, (high * cy - cube) * fall)))


@numba.njit(inline="always")
def ridge(cube, cy, nu, scale, inverse):  # type: ignore[no-untyped-def]
    """cy · s̃(ν, α). At grazing angles α is cut short at cube / 1e-12: at the same place for all ν, so the integral stays 1."""
    mid = scale * log_of(ONE + cube / max(cy, FLAT) * inverse)
    low = max(ZERO, mid - ONE)
    rising = (min(nu, mid) - low) / max(mid - low, FLAT)
    height = rising if nu < mid else mid + ONE - nu
    return cy * max(ZERO, height) / min(ONE, (mid + ONE) * np.float32(0.5))


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
    else:
        weighted = ridge(cube, cy, s0, s1, s2)
    g = cx * weighted / (safe * max(eps_b, safe))
    return g if r2 > SAFE_R2 else ZERO


@numba.njit(inline="always")
def _add(family, here, sums, values, lights, j, eps_b):  # type: ignore[no-untyped-def]
    """Add light j to the pixels of one tile, (6, AREA) and (3, AREA); returns how many it touches. values: scratch (AREA,).

    Several short loops, since the compiler uses vectors only where it needs few checks that arrays don't overlap.
    """
    light, hits = light_at(lights, j), np.int32(0)
    px, py, pz, nx, ny, nz = here[0], here[1], here[2], here[3], here[4], here[5]
    for i in range(AREA):
        g = transfer(family, px[i], py[i], pz[i], nx[i], ny[i], nz[i], light, eps_b)
        values[i] = g
        hits += np.int32(1) if g > ZERO else np.int32(0)
    for c in range(3):
        intensity, channel = lights[6 + c, j], sums[c]
        for i in range(AREA):
            channel[i] += values[i] * intensity
    return hits


@numba.njit(parallel=True, fastmath=True, cache=True)
def splat_lambert(family, receivers, first, tile_balls, block_balls, lights, eps_b, out, work):  # type: ignore[no-untyped-def]
    """out (T, 3, AREA) float64 += Σ w G_b I; work (B, 2) int64: pairs evaluated and pairs lit. The caller multiplies by ρ/π."""
    total = lights.shape[1]
    for b in numba.prange(len(first) - 1):
        start, stop = first[b], first[b + 1]
        sums, values = np.zeros((stop - start, 3, AREA), np.float32), np.zeros(AREA, np.float32)
        tested, touched = 0, 0
        for j in range(total):
            if not misses(block_balls[b], lights, j):
                for t in range(start, stop):
                    if misses(tile_balls[t], lights, j):
                        continue
                    tested += AREA
                    # The branch stands outside the pixel loop, each family compiled on its own: the loop then runs in vector lanes.
                    if family == HAT:
                        touched += _add(HAT, receivers[t], sums[t - start], values, lights, j, eps_b)
                    elif family == TWO_HATS:
                        touched += _add(TWO_HATS, receivers[t], sums[t - start], values, lights, j, eps_b)
                    else:
                        touched += _add(RIDGE, receivers[t], sums[t - start], values, lights, j, eps_b)
            if (j + 1) % BATCH == 0 or j + 1 == total:
                out[start:stop] += sums
                sums[:] = ZERO
        work[b, 0], work[b, 1] = tested, touched


@numba.njit(nogil=True, cache=True)
def lit_pairs(family, receivers, geometric, tile_balls, block_ball, lights, j, eps_b, offset, pairs, values, origins, directions):  # type: ignore[no-untyped-def]
    """Fill lit pairs (tile, place, light), w G_b and shadow rays from light j on, until the next light might not fit.

    receivers (T, 6, AREA), geometric (T, 3, AREA): the tiles of one block. Rays start `offset` off the receiver and end `offset`
    off the light, both along geometric normals; directions are unnormalised: distance 1 is the light. Returns the number of pairs,
    of pairs evaluated, and the light to go on with.
    """
    count, tested = 0, 0
    while j < lights.shape[1] and count + len(receivers) * AREA <= len(pairs):
        if not misses(block_ball, lights, j):
            for t in range(len(receivers)):
                if not misses(tile_balls[t], lights, j):
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
