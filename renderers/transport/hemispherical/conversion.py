"""Between spherical and hemispherical harmonics.

    C_(l,m),(l',m') = ∫_H H_l^m Y_l'^m' dω = δ_mm' 2π ∫₀¹ K̃P̃_l^|m|(μ) K P_l'^|m|(μ) dμ             Gautron 2006, equations 3.20-3.27

Rows are hemispherical. For odd m the integrand holds √μ; with μ = t² it is a polynomial times √(1+t²), on which Gauss–Legendre
converges geometrically. h = C s is the exact projection of a spherical series restricted to the hemisphere, s = Cᵀ h
the exact spherical coefficients of a hemispherical series that is zero below. They are inverse to each other only as
the spherical order goes to infinity: take it at least twice the hemispherical one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import order_of, polar_parts
from renderers.transport.hemispherical.quadrature import gauss_legendre

F64 = NDArray[np.float64]


@lru_cache(maxsize=16)
def conversion_matrix(order: int, sphere_order: int) -> F64:
    """C, float64 (order², sphere_order²), read-only: rows hemispherical, columns spherical."""
    t, weights = gauss_legendre(order + sphere_order + 40, 0, 1)
    mu, weights = t * t, 2 * t * weights
    matrix = np.zeros((order**2, sphere_order**2))
    for m in range(min(order, sphere_order)):
        upper = polar_parts(2 * mu - 1, order, m, 1 / np.sqrt(2 * np.pi))
        whole = polar_parts(mu, sphere_order, m, 1 / np.sqrt(4 * np.pi))
        block = 2 * np.pi * (upper * weights[:, None]).T @ whole
        rows, columns = np.arange(m, order), np.arange(m, sphere_order)
        for signed in {m, -m}:
            matrix[np.ix_(rows * (rows + 1) + signed, columns * (columns + 1) + signed)] = block
    matrix.flags.writeable = False
    return matrix


def to_spherical(hemispherical: F64, sphere_order: int) -> F64:
    """Exact spherical coefficients (..., sphere_order²) of hemispherical series (..., n²) that are zero below the horizon."""
    return _applied(_sparse(order_of(hemispherical.shape[-1]), sphere_order).T, hemispherical)


def to_hemispherical(spherical: F64, order: int) -> F64:
    """Exact hemispherical coefficients (..., order²) of spherical series (..., N²); what lies below the horizon is dropped."""
    return _applied(_sparse(order, order_of(spherical.shape[-1])), spherical)


@lru_cache(maxsize=16)
def _sparse(order: int, sphere_order: int) -> Any:
    return scipy.sparse.csr_array(conversion_matrix(order, sphere_order))


def _applied(matrix: Any, coefficients: F64) -> F64:
    flat = coefficients.reshape(-1, coefficients.shape[-1])
    return np.asarray((matrix @ flat.T).T).reshape(*coefficients.shape[:-1], matrix.shape[0])
