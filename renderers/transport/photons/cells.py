"""Gradients of irradiance from photons alone: hemisphere cells of flux become radiance, its differences become gradients.

M × N cells of equal projected solid angle, sin²θ_j = j/M, φ_k = 2πk/N: the flux Φ_jk of photons that came through a cell stands
for the radiance L_jk = Φ_jk/A · MN/π (Gautron 2006, equation 6.11), and

    ∇_r = Σ_jk L_jk v̂_k 2π/N [θ/2 - sin 2θ/4]                                                   over the cell's row
    ∇_p = Σ_k û_k 2π/N Σ_{j≥1} sinθ_j cos²θ_j (L_jk - L_{j-1,k})/r̄  +  v̂_k- Σ_j (sinθ_{j+1} - sinθ_j)(L_jk - L_{j,k-1})/r̄

r̄ is the arithmetic mean of the two cells' distances (each the harmonic mean over its photons; an empty cell takes the zone's). The
usual minimum would follow the smallest distance of photons that landed all over the zone: measured, it doubles the gradient.

Noise. In uniform light |∇|·scale/E is 2.1/√n whatever the grid, scale 1 for ∇_r and h for ∇_p. `thresholded` uses gradients from
n = n_grad on; `shrunk` multiplies each by max(0, 1 - noise²/|∇|²), the positive-part rule of James & Stein (1961): full where the
gradient stands out, none where it is noise.
"""

from __future__ import annotations

import numba
import numpy as np

NOISE = 2.1


@numba.njit(nogil=True, cache=True)
def cell_sums(u, v, w, flux, distance, count, rows, columns, power, inverse, hits):  # type: ignore[no-untyped-def]
    """Add photons to cells (rows, columns): power (…, 3), Σ 1/d, and hits; u, v, w: local direction, w along the normal."""
    for i in range(count):
        sin2 = min(u[i] * u[i] + v[i] * v[i], 1.0 - 1e-12)
        if w[i] <= 0.0:
            continue
        azimuth = np.arctan2(v[i], u[i]) / (2 * np.pi)
        azimuth -= np.floor(azimuth)
        j, k = int(sin2 * rows), min(int(azimuth * columns), columns - 1)
        for c in range(3):
            power[j, k, c] += flux[i, c]
        inverse[j, k] += 1.0 / distance[i]
        hits[j, k] += 1


@numba.njit(nogil=True, cache=True)
def gradients_of(radiance, distance, translation, rotation):  # type: ignore[no-untyped-def]
    """Fill translation, rotation (3 channels, 2 tangents) from cell radiance (M, N, 3) and cell distance (M, N)."""
    rows, columns, _ = radiance.shape
    step = 2 * np.pi / columns
    translation[:] = 0.0
    rotation[:] = 0.0
    for k in range(columns):
        middle, edge = (k + 0.5) * step, k * step
        cu, su, ce, se = np.cos(middle), np.sin(middle), np.cos(edge), np.sin(edge)
        before = k - 1 if k else columns - 1
        for j in range(rows):
            low, high = np.sqrt(j / rows), np.sqrt((j + 1) / rows)
            across = (high - low) * 2 / (distance[j, k] + distance[j, before])
            outward = 0.0
            if j:
                outward = step * low * (1 - low * low) * 2 / (distance[j, k] + distance[j - 1, k])
            ring = step * (_turning(high) - _turning(low))
            for c in range(3):
                radial = outward * (radiance[j, k, c] - radiance[j - 1, k, c]) if j else 0.0
                sideways = across * (radiance[j, k, c] - radiance[j, before, c])
                translation[c, 0] += cu * radial - se * sideways
                translation[c, 1] += su * radial + ce * sideways
                rotation[c, 0] -= su * ring * radiance[j, k, c]
                rotation[c, 1] += cu * ring * radiance[j, k, c]


@numba.njit(inline="always")
def _turning(sine):  # type: ignore[no-untyped-def]
    """∫ sin²θ dθ up to asin(sine)."""
    return (np.arcsin(sine) - sine * np.sqrt(max(0.0, 1 - sine * sine))) / 2


@numba.njit(nogil=True, cache=True)
def shrink(gradient, noise):  # type: ignore[no-untyped-def]
    """Scale all channels of a gradient (3, 2) by 1 - noise²/|∇|² of the sum over channels, 0 where noise prevails."""
    size2 = 0.0
    for a in range(2):
        mean = gradient[0, a] + gradient[1, a] + gradient[2, a]
        size2 += mean * mean
    gradient *= max(0.0, 1.0 - noise * noise / size2) if size2 > 0.0 else 0.0
