"""Support functions and bounds of virtual lights as numba functions that vectorise: no library call, few divisions.

A light is a row of 9 + 12 float32: position, normal, intensity / density of the level; then the support: inner and outer
coordinate, and its shape (`cuts.Family.parameters`). A pair of a receiver x and a light y has

    v = y - x,    r² = v·v,    c = max(0, -n_y·v),    α = r³ / c

and the weights come as c · s(α): the cosine is in the contribution anyway, and at grazing angles nothing is divided by zero.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.fused import fma
from renderers.transport.kernels import ONE, ZERO

FLAT = np.float32(1e-12)
LN2 = np.float32(np.log(2))
LEAST = np.float32(1e-30)
HALF, THREE_HALVES, THREE_EIGHTHS = np.float32(0.5), np.float32(1.5), np.float32(0.375)
INNER, OUTER, SHAPE = 9, 10, 11
# A receiver sees a light n·v above its own plane. Three products of coordinates of size 1 carry errors of about 1e-7 each: under
# this bound, lit or not is their rounding, and such lights (all those in the plane of a wall) count as not seen.
COPLANAR = np.float32(3e-7)


@numba.njit(inline="always")
def inverse_root(x):  # type: ignore[no-untyped-def]
    """1/√x of a normal float32 x > 0 to 3e-7, by the float's bits (3.4 % off), one step of third order (1e-4), one of second."""
    y = np.int32(np.int32(0x5F375A86) - (np.float32(x).view(np.int32) >> np.int32(1))).view(np.float32)
    h = fma(-x * y, y, ONE)
    y = fma(y * h, fma(THREE_EIGHTHS, h, HALF), y)
    return fma(HALF * y, fma(-x * y, y, ONE), y)


@numba.njit(inline="always")
def log_of(y):  # type: ignore[no-untyped-def]
    """ln y of a float32 y ≥ 1 to 2e-7 of max(1, ln y): exponent, and Cephes' polynomial in m - 1, m in [√½, √2)."""
    shifted = np.int32(np.float32(y).view(np.int32) - np.int32(0x3F3504F3))
    e = np.float32(np.int32(shifted >> np.int32(23)))
    m = np.int32(np.int32(shifted & np.int32(0x7FFFFF)) + np.int32(0x3F3504F3)).view(np.float32)
    f = m - ONE
    p = fma(np.float32(7.0376836292e-2), f, np.float32(-1.1514610310e-1))
    p = fma(p, f, np.float32(1.1676998740e-1))
    p = fma(p, f, np.float32(-1.2420140846e-1))
    p = fma(p, f, np.float32(1.4249322787e-1))
    p = fma(p, f, np.float32(-1.6668057665e-1))
    p = fma(p, f, np.float32(2.0000714765e-1))
    p = fma(p, f, np.float32(-2.4999993993e-1))
    p = fma(p, f, np.float32(3.3333331174e-1))
    return fma(e, LN2, fma(f * f, fma(p, f, -HALF), f))


@numba.njit(inline="always")
def hat(cube, c, low, rise, high, fall):  # type: ignore[no-untyped-def]
    """c · clip(min((α - low) · rise, (high - α) · fall), 0, 1) with α = cube / c, without the division."""
    up, down = fma(-low, c, cube) * rise, fma(high, c, -cube) * fall
    # comparisons, since so many calls of min and max aren't inlined any more
    least = up if up < down else down
    least = least if least < c else c
    return least if least > ZERO else ZERO


@numba.njit(inline="always")
def ridge(cube, c, nu, scale, inverse):  # type: ignore[no-untyped-def]
    """c · s̃(ν, α). At grazing angles α is cut short at cube / 1e-12: at the same place for all ν, so the integral stays 1."""
    mid = scale * log_of(fma(cube / max(c, FLAT), inverse, ONE))
    width = max(min(mid, ONE), FLAT)
    height = max(ZERO, nu - mid + width if nu < mid else (mid + ONE - nu) * width)
    return c * height / (width * min(ONE, (mid + ONE) * HALF))


@numba.njit(inline="always")
def roulette(cube, c, number, inverse):  # type: ignore[no-untyped-def]
    """c · W(u, α), u = number, x = α · inverse (`cuts.RouletteLevels`). At grazing angles α is cut short as in `ridge`."""
    x = cube / max(c, FLAT) * inverse
    kept = max(ZERO, min(ONE, fma(-number, x, THREE_HALVES)))
    near = min(x, THREE_HALVES)
    flank = max(ZERO, near - HALF)
    return c * x * kept / max(fma(-HALF * flank, flank, near), LEAST)


@numba.njit(inline="always")
def bound_at(bounds, t):  # type: ignore[no-untyped-def]
    """Row t of bounds (T, 9) (see `tiles.bounds_of`) as numbers, loaded once outside a loop over lights."""
    return (
        bounds[t, 0], bounds[t, 1], bounds[t, 2], bounds[t, 3], bounds[t, 4],
        bounds[t, 5], bounds[t, 6], bounds[t, 7], bounds[t, 8],
    )  # fmt: skip


@numba.njit(inline="always")
def misses(bound, x, y, z, a, b, c, inner, outer):  # type: ignore[no-untyped-def]
    """Whether a light at (x, y, z) with normal (a, b, c) brings nothing to all receivers within a bound.

    By the light's side, the receivers' planes, or the support's ends: bounds of α over a ball around the receivers.
    """
    bx, by, bz, radius, nx, ny, nz, spread, floor = bound
    vx, vy, vz = bx - x, by - y, bz - z
    r2 = max(fma(vx, vx, fma(vy, vy, vz * vz)), FLAT)
    d = r2 * inverse_root(r2)
    above = fma(a, vx, fma(b, vy, c * vz))
    highest, lowest = above + radius, above - radius
    near, far = max(ZERO, d - radius), d + radius
    facing = fma(spread, far, fma(nx, x, fma(ny, y, fma(nz, z, -floor))))
    beyond = near * near * near > outer * highest
    before = (lowest > ZERO) & (far * far * far < inner * lowest)
    return (highest <= ZERO) | (facing <= COPLANAR) | beyond | before
