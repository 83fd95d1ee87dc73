"""numba kernels of photon tracing: where a photon arrives, how it leaves a diffuse surface, who goes on. All release the GIL."""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.photons.counter_random import number

TINY = 1e-6


@numba.njit(nogil=True, cache=True)
def arrive(positions, normals, triangles, face_normals, triangle, u, v, travel, flux, position, came, received, shading, geometric):  # type: ignore[no-untyped-def]
    """Fill position, came (unit, back along the way), received (flux by the shading normal), shading and geometric normals (N, 3).

    Both normals are turned to the side the photon came from, each by its own sign, as two-sided shading does.
    """
    for i in range(len(triangle)):
        a, b, c = triangles[triangle[i], 0], triangles[triangle[i], 1], triangles[triangle[i], 2]
        second, third = float(u[i]), float(v[i])
        first = 1.0 - second - third
        length2 = cos_s = cos_g = 0.0
        for k in range(3):
            position[i, k] = first * positions[a, k] + second * positions[b, k] + third * positions[c, k]
            came[i, k] = -travel[i, k]
            n = first * normals[a, k] + second * normals[b, k] + third * normals[c, k]
            length2 += n * n
            shading[i, k] = n
            cos_s -= n * travel[i, k]
            cos_g -= face_normals[triangle[i], k] * travel[i, k]
        length = np.sqrt(length2)
        flat = length <= 1e-6  # opposite vertex normals cancel: flat shading, as `surface_at`
        cos_s = cos_g if flat else cos_s / length
        factor = abs(cos_s) / max(abs(cos_g), TINY)
        for k in range(3):
            n = face_normals[triangle[i], k] if flat else shading[i, k] / length
            shading[i, k] = n if cos_s >= 0 else -n
            g = face_normals[triangle[i], k]
            geometric[i, k] = g if cos_g >= 0 else -g
            received[i, k] = flux[i, k] * factor


@numba.njit(nogil=True, cache=True)
def scatter_lambert(key, index, first, shading, geometric, base, received, direction, flux):  # type: ignore[no-untyped-def]
    """Fill direction (cosine about the shading normal) and flux = ρ Φ |ω·n_g| / |ω·n_s| of every photon, (N, 3)."""
    for i in range(len(index)):
        r = number(key, index[i], np.uint64(first + 1))
        phi = 2 * np.pi * number(key, index[i], np.uint64(first + 2))
        up, side = np.sqrt(1 - r), np.sqrt(r)
        x, y = side * np.cos(phi), side * np.sin(phi)
        nx, ny, nz = float(shading[i, 0]), float(shading[i, 1]), float(shading[i, 2])
        sign = 1.0 if nz >= 0 else -1.0
        a = -1 / (sign + nz)
        b = nx * ny * a
        dx = x * (1 + sign * nx * nx * a) + y * b + up * nx
        dy = x * sign * b + y * (sign + ny * ny * a) + up * ny
        dz = -x * sign * nx - y * ny + up * nz
        cos_g = abs(dx * geometric[i, 0] + dy * geometric[i, 1] + dz * geometric[i, 2])
        factor = cos_g / max(up, TINY)
        direction[i, 0], direction[i, 1], direction[i, 2] = dx, dy, dz
        for k in range(3):
            flux[i, k] = base[i, k] * received[i, k] * factor


@numba.njit(nogil=True, cache=True)
def next_rays(key, index, dimension, position, geometric, received, origin, direction, flux, offset):  # type: ignore[no-untyped-def]
    """Russian roulette; survivors are moved to the front of index, origin, direction and flux; returns how many.

    Origins lie `offset` off the surface, on the side the photon leaves to.
    """
    count = 0
    for i in range(len(index)):
        before = max(received[i, 0], received[i, 1], received[i, 2])
        after = max(flux[i, 0], flux[i, 1], flux[i, 2])
        if not after > 0:
            continue
        survival = min(1.0, float(after) / float(before))
        if number(key, index[i], np.uint64(dimension)) >= survival:
            continue
        outward = 0.0
        for k in range(3):
            outward += direction[i, k] * geometric[i, k]
        side = offset if outward >= 0 else -offset
        index[count] = index[i]
        for k in range(3):
            origin[count, k] = position[i, k] + side * geometric[i, k]
            direction[count, k] = direction[i, k]
            flux[count, k] = flux[i, k] / survival
        count += 1
    return count
