"""Radiance records: incoming radiance of a hemisphere as coefficients of hemispherical harmonics, and their translation gradients.

Cells j = 0 … M-1 (from the pole), k = 0 … N-1 of equal solid angle: cos θ from 1 - j/M to 1 - (j+1)/M; names as in `gradients`.

    λ_i  = Σ_jk L_jk ∫_jk H_i dω                                                         no cosine: it is in the BRDF's coefficients
    ∇λ_i = Σ_k û_k 2π/N Σ_{j≥1} sin θ_j⁻ cos θ_j⁻ H_i(θ_j⁻, φ_k) (L_jk - L_{j-1,k}) / min(r_jk, r_{j-1,k})
         + Σ_k v̂_k⁻ Σ_j ∫_θ_j⁻^θ_j⁺ H_i(θ, φ_k⁻) dθ (L_jk - L_{j,k-1}) / min(r_jk, r_{j,k-1})         Křivánek et al. 2005

The second sum's integral is exact, where the printed one takes H_i at a cell's centre. The cosine being two harmonics, irradiance
and its gradient follow without error: E = √(π/2) λ_00 + √(π/6) λ_10, and for H_i = cos θ the sums are Ward & Heckbert's.

H_i(θ, φ) is a product, a function of θ times cos mφ or sin |m|φ. So each ring is summed over its sectors with 2n - 1 weights first,
and those sums over the rings with n² weights: a sixth of the work of one sum over all cells at order 10.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.hemisphere import Grid, Hemispheres, PolarSampler
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.records import Records, Sites
from renderers.transport.hemispherical.basis import degrees, directions_of, hemispherical_harmonics, index
from renderers.transport.hemispherical.quadrature import gauss_legendre

F64 = NDArray[np.float64]
NODES = 16  # in each ring: exact for even m, and for odd m, with √μ at the horizon, to 1e-5 of the ring
ZEROTH, FIRST = float(np.sqrt(np.pi / 2)), float(np.sqrt(np.pi / 6))


class RadianceTables(NamedTuple):
    """Constants of an M × N grid at order n, Q = 2n - 1 functions of φ.

    around (5, N, Q): weights of the sectors for λ, then for the edges between rings (x, y) and between sectors (x, y). across
    (3, M, n²): weights of the rings for λ, the edges between rings, those between sectors. place (n²,): which of the Q each
    coefficient goes with. swept (M,): ∫ sin θ dμ over a ring. cosine (M,): ∫ cos θ dω over a cell.
    """

    around: F64
    across: F64
    place: NDArray[np.int64]
    swept: F64
    cosine: F64


@lru_cache(maxsize=8)
def radiance_tables(rings: int, sectors: int, order: int) -> RadianceTables:
    """See `RadianceTables`."""
    step, m = 2 * np.pi / sectors, np.arange(1 - order, order)
    phi: F64 = np.asarray(step * np.arange(sectors), np.float64)
    low, high = _azimuthal(m, phi), _azimuthal(m, phi + step)
    # ∫ cos mφ = [sin mφ]/m and ∫ sin |m|φ = -[cos mφ]/|m|: the function of -m, over m, with the sign of m
    cells = np.where(m == 0, step, (high - low)[:, ::-1] / np.where(m == 0, 1, m))
    middle = _azimuthal(m, phi + step / 2)
    u, v = (phi + step / 2)[:, None], phi[:, None]
    around = np.stack([cells, middle * np.cos(u), middle * np.sin(u), -low * np.sin(v), low * np.cos(v)])
    mu = 1 - np.arange(rings + 1) / rings
    theta = np.arccos(mu)
    nodes, share = gauss_legendre(NODES, 0, 1)
    between = mu[1:, None] + nodes / rings
    slanted = theta[:-1, None] + nodes * np.diff(theta)[:, None]
    edge = step * np.sin(theta[:-1]) * mu[:-1]
    across = np.stack(
        [
            np.einsum("q,jqi->ji", share, _polar(between, order)) / rings,
            edge[:, None] * _polar(mu[:-1], order),
            np.einsum("q,jqi->ji", share, _polar(np.cos(slanted), order)) * np.diff(theta)[:, None],
        ]
    )
    swept = (theta - np.sin(theta) * np.cos(theta)) / 2
    return RadianceTables(around, across, degrees(order)[1] + order - 1, np.diff(swept), step * (mu[:-1] ** 2 - mu[1:] ** 2) / 2)


def _azimuthal(m: NDArray[np.int64], phi: F64) -> F64:
    """cos mφ for m ≥ 0, sin |m|φ for m < 0: (N, Q)."""
    turned = np.abs(m) * phi[:, None]
    return np.asarray(np.where(m >= 0, np.cos(turned), np.sin(turned)))


def _polar(mu: F64, order: int) -> F64:
    """What H_i is at φ with cos mφ = 1 (m ≥ 0) or sin |m|φ = 1 (m < 0), (..., n²): that of |m| for both."""
    values = hemispherical_harmonics(directions_of(mu, np.zeros_like(mu)), order)
    degree, m = degrees(order)
    return np.asarray(values[..., degree * (degree + 1) + np.abs(m)])


class RadianceMoments(NamedTuple):
    """Of K hemispheres, in their frames: coefficients (K, n², 3), gradients (K, 2, n², 3) along the tangents, rotation (K, 3, 2):
    gradient of the irradiance [channel, tangent], radius (K,): harmonic mean distance, cosine weights, ∞ where nothing is hit."""

    coefficients: F64
    gradients: F64
    rotation: F64
    radius: F64


def radiance_moments(radiance: NDArray[np.floating], nearness: NDArray[np.floating], order: int) -> RadianceMoments:
    """Moments of hemispheres of equal solid angles: radiance (K, M, N, 3) and nearness 1/r (K, M, N), 0 where nothing is hit."""
    count, rings, sectors = nearness.shape
    out = RadianceMoments(
        np.zeros((count, order**2, 3)), np.zeros((count, 2, order**2, 3)), np.zeros((count, 3, 2)), np.full(count, np.inf)
    )
    _radiance(radiance, nearness, *radiance_tables(rings, sectors, order), *out)
    return out


class RadianceSampler(PolarSampler):
    """Computes radiance records of an order ≥ 2 by casting rays; in use like a `PolarSampler`."""

    equal_solid_angle = True

    def __init__(
        self, world: World, grid: Grid, incoming: Incoming, order: int, seed: int = 0, jitter: bool = True,
        counters: Counter[str] | None = None,
    ) -> None:  # fmt: skip
        if order < 2:
            raise ValueError(f"radiance records need order 2 at least, got {order}")
        super().__init__(world, grid, incoming, seed, jitter, counters)
        self.order = order

    def summed(self, sites: Sites, cast: Hemispheres) -> Records:
        """See `PolarSampler.summed`."""
        return radiance_records(sites, cast.tangents, radiance_moments(cast.radiance, cast.nearness, self.order))


def radiance_records(sites: Sites, tangents: F64, moments: RadianceMoments) -> Records:
    """Records with coefficients; their irradiance and its gradients are those of the coefficients."""
    second = index(1, 0)
    irradiance = ZEROTH * moments.coefficients[:, 0] + FIRST * moments.coefficients[:, second]
    slope = ZEROTH * moments.gradients[:, :, 0] + FIRST * moments.gradients[:, :, second]
    return Records(
        position=sites.position,
        normal=sites.normal,
        radius=moments.radius,
        irradiance=irradiance,
        translation=slope.transpose(0, 2, 1) @ tangents,
        rotation=moments.rotation @ tangents,
        coefficients=moments.coefficients,
        coefficient_gradients=moments.gradients,
        tangents=tangents,
    )


@numba.njit(nogil=True, cache=True)
def _radiance(light, near, around, across, place, swept, cosine, coefficients, gradients, rotation, radius):  # type: ignore[no-untyped-def]
    count, rings, sectors = near.shape
    middle = around.shape[2] // 2
    sums = np.empty((5, 3, around.shape[2]))
    for record in range(count):
        total = 0.0
        for j in range(rings):
            sums[:] = 0.0
            for k in range(sectors):
                _add_cell(light[record], near[record], j, k, around, sums)
                total += cosine[j] * near[record, j, k]
            for i in range(len(place)):
                q = place[i]
                for c in range(3):
                    coefficients[record, i, c] += across[0, j, i] * sums[0, c, q]
                    for t in range(2):
                        slope = across[1, j, i] * sums[1 + t, c, q] + across[2, j, i] * sums[3 + t, c, q]
                        gradients[record, t, i, c] += slope
            for c in range(3):
                rotation[record, c, 0] -= swept[j] * sums[0, c, middle - 1]
                rotation[record, c, 1] += swept[j] * sums[0, c, middle + 1]
        if total > 0:
            radius[record] = np.pi / total


@numba.njit(inline="always")
def _add_cell(light, near, j, k, around, sums):  # type: ignore[no-untyped-def]
    """A cell's share in the sums over the sectors (5, 3, Q)."""
    before = k - 1 if k else near.shape[1] - 1
    inner = max(near[j, k], near[j - 1, k]) if j else 0.0
    beside = max(near[j, k], near[j, before])
    for c in range(3):
        here = float(light[j, k, c])
        outward = inner * (here - light[j - 1, k, c]) if j else 0.0
        sideways = beside * (here - light[j, before, c])
        for q in range(around.shape[2]):
            sums[0, c, q] += here * around[0, k, q]
            sums[1, c, q] += outward * around[1, k, q]
            sums[2, c, q] += outward * around[2, k, q]
            sums[3, c, q] += sideways * around[3, k, q]
            sums[4, c, q] += sideways * around[4, k, q]
