"""Loops over planes (`plane`): rays through their pixels, and sums over them."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(nogil=True, cache=True)
def rays_through(local, position, normal, geometric, tangents, offset, origins, directions):  # type: ignore[no-untyped-def]
    """origins, directions (K·P, 3) of rays along `local` (P, 3), from `offset` above or below the surface, as they leave."""
    ray = 0
    for record in range(len(position)):
        n, g, s, t = normal[record], geometric[record], tangents[record, 0], tangents[record, 1]
        for p in range(len(local)):
            side = 0.0
            for c in range(3):
                d = local[p, 0] * s[c] + local[p, 1] * t[c] + local[p, 2] * n[c]
                directions[ray, c] = d
                side += d * g[c]
            move = offset if side >= 0 else -offset
            for c in range(3):
                origins[ray, c] = position[record, c] + move * g[c]
            ray += 1


@numba.njit(nogil=True, cache=True)
def sums(radiance, nearness, tables, irradiance, translation, rotation, radius):  # type: ignore[no-untyped-def]
    """Moments of planes (K, N, N, 3), (K, N, N); outputs as in `gradients.Moments`."""
    cosine, turn, slant, along, first, second, push = tables
    size = len(cosine)
    total = cosine.sum()
    for record in range(len(nearness)):
        light, near, mean = radiance[record], nearness[record], 0.0
        for i in range(size):
            for j in range(size):
                here = near[i, j] * slant[i, j]
                below = max(here, near[i - 1, j] * slant[i - 1, j]) * along[i - 1, j] if i else 0.0
                beside = max(here, near[i, j - 1] * slant[i, j - 1]) * along[j - 1, i] if j else 0.0
                mean += near[i, j] * cosine[i, j]
                for c in range(3):
                    value = light[i, j, c]
                    irradiance[record, c] += cosine[i, j] * value
                    rotation[record, c, 0] += turn[i, j, 0] * value
                    rotation[record, c, 1] += turn[i, j, 1] * value
                    translation[record, c, 0] += below * (value - light[i - 1, j, c])
                    translation[record, c, 1] += beside * (value - light[i, j - 1, c])
        for e in range(len(first)):
            a, b, x, y = first[e, 0], first[e, 1], second[e, 0], second[e, 1]
            swept = max(near[a, b] * slant[a, b], near[x, y] * slant[x, y])
            for c in range(3):
                step = swept * (light[x, y, c] - light[a, b, c])
                translation[record, c, 0] += step * push[e, 0]
                translation[record, c, 1] += step * push[e, 1]
        radius[record] = total / mean if mean > 0 else np.inf
