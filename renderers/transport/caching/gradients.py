"""Irradiance, its gradients and the harmonic mean distance of polar hemispheres.

Cells j = 0 … M-1 (from the pole), k = 0 … N-1 of equal projected solid angle: sin θ from √(j/M) to √((j+1)/M), φ from 2πk/N to
2π(k+1)/N; û_k points along φ at the centre of a cell, v̂_k at a right angle to it, v̂_k⁻ to the cell's lower edge.

    E    = π/(MN) Σ L_jk
    ∇_tE = Σ_k û_k 2π/N Σ_{j≥1} sin θ_j⁻ cos² θ_j⁻ (L_jk - L_{j-1,k}) / min(r_jk, r_{j-1,k})
         + Σ_k v̂_k⁻ Σ_j (sin θ_j⁺ - sin θ_j⁻) (L_jk - L_{j,k-1}) / min(r_jk, r_{j,k-1})            Ward & Heckbert 1992
    ∇_rE = Σ_k v̂_k Σ_j L_jk 2π/N ½ [θ - sin θ cos θ]                                               argument n_k × n
    R    = MN / Σ 1/r                                                                              Ward 1988
    H    = Σ_jk û_k û_kᵀ 2π/N 4 sin² θ_j⁻ cos² θ_j⁻ (L_jk - L_{j-1,k}) / min(r_jk, r_{j-1,k})²
         + Σ_jk (û_k⁻ v̂_k⁻ᵀ + v̂_k⁻ û_k⁻ᵀ) 1/M (L_jk - L_{j,k-1}) / min(r_jk, r_{j,k-1})²

H is the occlusion-aware Hessian of the irradiance (Schwarzhaupt, Wann Jensen & Jarosz 2012) in the tangent plane: an edge r(s) that
stays where it is while the observer moves by δ sweeps the cosine-weighted solid angle ∫∫ (n·r) δ·(r × r') / |r - tδ|⁴ ds dt, with
t from 0 to 1. Its first order makes ∇_tE, its second, 2 ∫ (n·r) δ·(r × r') (r·δ) / |r|⁶ ds, makes H; r(s): arcs between cells.

The nearer of two surfaces decides how fast the edge between them moves, hence the minimum. The bracket integrates tan θ exactly
over a ring, where the usual sum of tan θ_j at cell centres loses up to 14 % in the outermost one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA

F64 = NDArray[np.float64]


LOW, HIGH = 0.5, 0.97  # sin² of the polar angles, 45° and 80°, between which what is hit counts for the clearance


class PolarTables(NamedTuple):
    """Constants of an M × N grid. along, across, turn, bend (M,): see `polar_tables`. centre, edge (N, 2): cos, sin of azimuths."""

    along: F64
    across: F64
    turn: F64
    bend: F64
    centre: F64
    edge: F64


@lru_cache(maxsize=32)
def polar_tables(rings: int, sectors: int) -> PolarTables:
    """along: 2π/N sin θ⁻ cos² θ⁻; across: sin θ⁺ - sin θ⁻; turn: 2π/N ½ [θ - sin θ cos θ]; bend: 2π/N 4 sin² θ⁻ cos² θ⁻."""
    sine = np.sqrt(np.arange(rings + 1) / rings)
    theta = np.arcsin(sine)
    swept = (theta - sine * np.cos(theta)) / 2
    step = 2 * np.pi / sectors
    lower = sine[:-1]
    phi = step * np.arange(sectors)
    return PolarTables(
        along=step * lower * (1 - lower**2),
        across=np.diff(sine),
        turn=step * np.diff(swept),
        bend=step * 4 * lower**2 * (1 - lower**2),
        centre=np.stack([np.cos(phi + step / 2), np.sin(phi + step / 2)], axis=1),
        edge=np.stack([np.cos(phi), np.sin(phi)], axis=1),
    )


class Moments(NamedTuple):
    """Of K hemispheres, in their frames: irradiance (K, 3), translation and rotation (K, 3, 2) [channel, tangent], radius (K,);
    hessian (K, 3): elements xx, xy, yy of the Hessian of the luminance of the irradiance; clearance (K,), where known: how far
    away along the surface something stands or hangs low, ∞ where nothing does."""

    irradiance: F64
    translation: F64
    rotation: F64
    radius: F64
    hessian: F64
    clearance: F64 | None = None

    @property
    def curvature(self) -> F64:
        """Largest eigenvalue of the Hessian, in magnitude, over the luminance of the irradiance; 0 in the dark: (K,)."""
        xx, xy, yy = self.hessian.T
        largest = np.abs(xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
        bright = self.irradiance @ LUMA
        return np.where(bright > 0, largest / np.where(bright > 0, bright, 1), 0)


def polar_moments(radiance: NDArray[np.floating], nearness: NDArray[np.floating]) -> Moments:
    """Moments of hemispheres with radiance (K, M, N, 3) and nearness 1/r (K, M, N), 0 where nothing is hit (R = ∞ if nowhere)."""
    count, rings, sectors = nearness.shape
    out = Moments(
        np.zeros((count, 3)), np.zeros((count, 3, 2)), np.zeros((count, 3, 2)), np.full(count, np.inf), np.zeros((count, 3))
    )
    _polar(radiance, nearness, *polar_tables(rings, sectors), *out[:5])
    return out._replace(clearance=polar_clearance(nearness))


def polar_clearance(nearness: NDArray[np.floating]) -> F64:
    """Smallest distance r sin θ, along the tangent plane, of what is seen 10° to 45° above it, (K,), from nearness (K, M, N).

    A wall that stands on the surface is seen there at its distance from the foot. Lower rays would hit a hollow surface itself, at
    any distance: from 10° up it is met where its normal has turned by 20° or more.
    """
    square = (np.arange(nearness.shape[1]) + 0.5) / nearness.shape[1]
    low = (square >= LOW) & (square <= HIGH)
    nearest = (nearness[:, low].max(axis=2) / np.sqrt(square[low])).max(axis=1, initial=0).astype(np.float64)
    return np.where(nearest > 0, 1 / np.where(nearest > 0, nearest, 1), np.inf)


@numba.njit(nogil=True, cache=True)
def _polar(radiance, nearness, along, across, turn, bend, centre, edge, irradiance, translation, rotation, radius, hessian):  # type: ignore[no-untyped-def]
    count, rings, sectors = nearness.shape
    for record in range(count):
        light, near = radiance[record], nearness[record]
        total = 0.0
        for k in range(sectors):
            before = k - 1 if k else sectors - 1
            bent, sheared = 0.0, 0.0
            for c in range(3):
                outward, sideways, turned, sum_e, bent_c, sheared_c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for j in range(rings):
                    here = light[j, k, c]
                    sum_e += here
                    turned += turn[j] * here
                    if j:
                        step = max(near[j, k], near[j - 1, k]) * (here - light[j - 1, k, c])
                        outward += along[j] * step
                        bent_c += bend[j] * max(near[j, k], near[j - 1, k]) * step
                    step = max(near[j, k], near[j, before]) * (here - light[j, before, c])
                    sideways += across[j] * step
                    sheared_c += max(near[j, k], near[j, before]) * step
                bent += LUMA[c] * bent_c
                sheared += LUMA[c] * sheared_c / rings
                irradiance[record, c] += sum_e
                translation[record, c, 0] += outward * centre[k, 0] - sideways * edge[k, 1]
                translation[record, c, 1] += outward * centre[k, 1] + sideways * edge[k, 0]
                rotation[record, c, 0] -= turned * centre[k, 1]
                rotation[record, c, 1] += turned * centre[k, 0]
            hessian[record, 0] += bent * centre[k, 0] ** 2 - 2 * sheared * edge[k, 0] * edge[k, 1]
            hessian[record, 1] += bent * centre[k, 0] * centre[k, 1] + sheared * (edge[k, 0] ** 2 - edge[k, 1] ** 2)
            hessian[record, 2] += bent * centre[k, 1] ** 2 + 2 * sheared * edge[k, 0] * edge[k, 1]
            for j in range(rings):
                total += near[j, k]
        for c in range(3):
            irradiance[record, c] *= np.pi / (rings * sectors)
        if total > 0:
            radius[record] = rings * sectors / total
