"""The matrices of a turn of hemispherical harmonics about y by an angle β: integrals over the lune H - I that stays up.

    deletion   M(β)_ij   = ∫_{H-I} H_i(ω) H_j(ω) dω          what sinks is cut away, nothing is turned
    rotation   M_R(β)_ij = ∫_{H-I} H_i(ω) H_j(R_β ω) dω      g = M_R(β)ᵀ f: the exact projection of the turned, cut function
                                                             Gautron 2006, sections 3.3.2 and 3.3.3
Both are zero between functions even in y (m ≥ 0) and odd in y (m < 0): tables store those two blocks only.

The tables interpolate linearly between angles β_k = π/2 (k/K)^1.5. Functions at the horizon change fastest at small angles: with
equal steps the first interval would have the largest error, 4.7 % at order 10 with 129 angles (spectral norm); so it is 0.55 %.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import degrees, hemispherical_harmonics
from renderers.transport.hemispherical.quadrature import Quadrature, lune_quadrature

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
Kind = Literal["deletion", "rotation"]
QUARTER = 0.5 * np.pi
GRADING = 1.5
ANGLES = 129


class LuneTable(NamedTuple):
    """Parity blocks at each angle: even float32 (K, e, e), odd (K, o, o); even_rows, odd_rows int64: their coefficients."""

    even: F32
    odd: F32
    even_rows: NDArray[np.int64]
    odd_rows: NDArray[np.int64]

    def place(self, beta: F64) -> tuple[NDArray[np.int64], F64]:
        """Lower angle's number and weight of the upper one, for angles in [0, π/2]."""
        last = len(self.even) - 1
        lower = np.minimum((last * (beta / QUARTER) ** (1 / GRADING)).astype(np.int64), last - 1)
        start, stop = _angle(lower, last), _angle(lower + 1, last)
        return lower, np.clip((beta - start) / (stop - start), 0, 1)

    def matrix(self, beta: float) -> F64:
        """The interpolated matrix at one angle in [0, π/2], float64 (n², n²)."""
        lower, weight = self.place(np.array([beta]))
        order2 = len(self.even_rows) + len(self.odd_rows)
        result = np.zeros((order2, order2))
        for blocks, rows in ((self.even, self.even_rows), (self.odd, self.odd_rows)):
            near, far = blocks[lower[0]].astype(np.float64), blocks[lower[0] + 1].astype(np.float64)
            result[np.ix_(rows, rows)] = near + weight[0] * (far - near)
        return result


def deletion_matrix(beta: float, order: int) -> F64:
    """M(β), float64 (order², order²), for β in [-π, π]: symmetric, eigenvalues in [0, 1], not a projector (apply it once)."""
    directions, weights = _half_lune(beta, order)
    values = hemispherical_harmonics(directions, order)
    return _blockwise(values, values, weights, order)


def rotation_matrix_y(beta: float, order: int) -> F64:
    """M_R(β), float64 (order², order²), for β in [-π, π]: rows are the source, so that g = M_R(β)ᵀ f. M_R(-β) = M_R(β)ᵀ."""
    directions, weights = _half_lune(beta, order)
    turned = directions @ about_y(beta).T
    turned[:, 2] = np.maximum(turned[:, 2], 0)
    return _blockwise(hemispherical_harmonics(directions, order), hemispherical_harmonics(turned, order), weights, order)


@lru_cache(maxsize=8)
def lune_table(kind: Kind, order: int, angles: int = ANGLES) -> LuneTable:
    """The table of one kind with `angles` ≥ 2 angles in [0, π/2]; kept for later calls."""
    if angles < 2:
        raise ValueError(f"a table needs at least 2 angles, got {angles}")
    m = degrees(order)[1]
    even, odd = np.flatnonzero(m >= 0), np.flatnonzero(m < 0)
    make = deletion_matrix if kind == "deletion" else rotation_matrix_y
    matrices = [make(float(_angle(k, angles - 1)), order) for k in range(angles)]
    blocks = [np.stack([a[np.ix_(rows, rows)] for a in matrices]).astype(np.float32) for rows in (even, odd)]
    return LuneTable(blocks[0], blocks[1], even, odd)


def about_y(beta: float) -> F64:
    """Rotation matrix about y by β, float64 (3, 3): z goes towards x."""
    c, s = np.cos(beta), np.sin(beta)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def enough_nodes(order: int) -> int:
    """Nodes a side of the lune quadrature (even) at which the matrices are exact to about 1e-9 (measured up to order 20)."""
    return 24 + 4 * order


def _angle(k: NDArray[np.int64] | int, last: int) -> F64:
    return np.asarray(QUARTER * (np.asarray(k) / last) ** GRADING)


def _half_lune(beta: float, order: int) -> Quadrature:
    """The half y < 0 of the lune that stays above the horizon, with doubled weights: the integrands are even in y."""
    low, high = (beta, np.pi) if beta >= 0 else (0.0, np.pi + beta)
    directions, weights = lune_quadrature(low, high, enough_nodes(order))
    half = len(weights) // 2
    return Quadrature(directions[:half], 2 * weights[:half])


def _blockwise(first: F64, second: F64, weights: F64, order: int) -> F64:
    """Σ weights first_i second_j for i and j of equal parity, 0 elsewhere."""
    result = np.zeros((order**2, order**2))
    even = degrees(order)[1] >= 0
    for rows in (np.flatnonzero(even), np.flatnonzero(~even)):
        result[np.ix_(rows, rows)] = (first[:, rows] * weights[:, None]).T @ second[:, rows]
    return result
