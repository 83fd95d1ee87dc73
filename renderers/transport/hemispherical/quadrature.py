"""Nodes and weights for integrals over the hemisphere, the sphere and lunes (digons) of the hemisphere."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import directions_of

F64 = NDArray[np.float64]


class Quadrature(NamedTuple):
    """∫ f dω ≈ Σ f(directions) weights: unit directions float64 (Q, 3), weights float64 (Q,) in sr."""

    directions: F64
    weights: F64


def gauss_legendre(count: int, low: float = -1.0, high: float = 1.0) -> tuple[F64, F64]:
    """Nodes and weights (count,) on [low, high]; exact for polynomials of degree 2·count - 1."""
    nodes, weights = _legendre(count)
    half = 0.5 * (high - low)
    return low + half * (nodes + 1), half * weights


@lru_cache(maxsize=64)
def _legendre(count: int) -> tuple[F64, F64]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights


def hemisphere_quadrature(mu_nodes: int, phi_nodes: int) -> Quadrature:
    """Gauss–Legendre in μ = cos θ on [0, 1] times midpoints in φ.

    Exact for products of two functions of order n if mu_nodes ≥ n and phi_nodes ≥ 2n - 1.
    """
    return _product(*gauss_legendre(mu_nodes, 0, 1), phi_nodes)


def sphere_quadrature(mu_nodes: int, phi_nodes: int) -> Quadrature:
    """Gauss–Legendre in cos θ on [-1, 1] times midpoints in φ: exact for products of two spherical harmonics of order mu_nodes
    if phi_nodes ≥ 2 · mu_nodes - 1."""
    return _product(*gauss_legendre(mu_nodes), phi_nodes)


def lune_quadrature(low: float, high: float, nodes: int) -> Quadrature:
    """The lune {low ≤ ψ ≤ high} of directions (cos ψ √(1-y²), y, sin ψ √(1-y²)), polar axis y; the hemisphere is [0, π].

    y = sin(π t/2) and ψ = middle - half·cos(π u): the sines of both maps absorb the square roots at the edges of the harmonics.
    """
    t, t_weights = gauss_legendre(nodes)
    u, u_weights = gauss_legendre(nodes, 0, 1)
    half = 0.5 * (high - low)
    psi = 0.5 * (low + high) - half * np.cos(np.pi * u)
    psi_weights = half * np.pi * np.sin(np.pi * u) * u_weights
    y, r = np.sin(0.5 * np.pi * t), np.cos(0.5 * np.pi * t)
    y_weights = 0.5 * np.pi * r * t_weights
    shape = (nodes, nodes)
    directions = [np.outer(r, np.cos(psi)), np.broadcast_to(y[:, None], shape), np.outer(r, np.sin(psi))]
    return Quadrature(np.stack(directions, axis=-1).reshape(-1, 3), np.outer(y_weights, psi_weights).ravel())


def _product(mu: F64, mu_weights: F64, phi_nodes: int) -> Quadrature:
    phi = 2 * np.pi * (np.arange(phi_nodes) + 0.5) / phi_nodes
    directions = directions_of(mu[:, None], phi[None, :]).reshape(-1, 3)
    return Quadrature(directions, np.repeat(mu_weights * (2 * np.pi / phi_nodes), phi_nodes))
