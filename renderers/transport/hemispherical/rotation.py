"""Rotation of hemispherical harmonics: g(ω) = f(Rᵀω) where Rᵀω was above the old horizon, and 0 elsewhere.

With R = R_z(α) R_y(β) R_z(γ) (Euler angles z-y-z) the coefficients become g = Z(α) T(β) Z(γ) f. Turns about z are exact. Those
about y lose what sinks below the horizon; Gautron 2006, section 3.3, has three of them:

    precomputed   T = M_R(β)ᵀ, interpolated in a table: up to that, the best any matrix can do (default)
    spherical     T = C D(R) Cᵀ through spherical harmonics of a higher order, with no Euler angles
    analytic      T = D(R_y(β')) M(β), sin(β'/2) = √2 sin(β/2): digon deletion, then the spherical matrix used on hemispherical
                  coefficients. It carries the pole to its place and shears the rest: for reproduction only, β ≤ π/2

Frame change: R = F_to F_fromᵀ with the rows t, b, n of each frame.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import degrees, order_of
from renderers.transport.hemispherical.conversion import to_hemispherical, to_spherical
from renderers.transport.hemispherical.lune import ANGLES, QUARTER, about_y, lune_table, rotation_matrix_y
from renderers.transport.hemispherical.sphere_rotation import rotate_spherical
from renderers.transport.threads import chunks, in_threads

F64 = NDArray[np.float64]
Method = Literal["precomputed", "spherical", "analytic"]
SAME = 1e-5  # largest entry of R - 1 that counts as no rotation
UPRIGHT = 1e-3  # β in radians under which only the turn about z is applied
CHUNK = 256


def rotate(
    coefficients: F64, rotation: F64, method: Method = "precomputed", angles: int = ANGLES, sphere_order: int | None = None
) -> F64:
    """Coefficients of the turned functions, float64 of the same shape.

    coefficients: (N, n²) or (N, n², C), e.g. C = 3 for RGB; rotation: (N, 3, 3), or one (3, 3) for all.
    angles: size of the tables of `precomputed` and `analytic`. sphere_order: of `spherical`, by default 3n.
    Raises ValueError for `analytic` beyond π/2.
    """
    order = order_of(coefficients.shape[1])
    flat = np.array(coefficients, np.float64).reshape(*coefficients.shape[:2], math.prod(coefficients.shape[2:]))
    rotations = np.broadcast_to(np.asarray(rotation, np.float64), (len(flat), 3, 3))
    moved = np.flatnonzero(np.abs(rotations - np.eye(3)).max(axis=(1, 2)) >= SAME)
    if method == "spherical":
        whole = to_spherical(flat[moved].transpose(0, 2, 1), sphere_order or 3 * order).transpose(0, 2, 1)
        turned = rotate_spherical(whole, rotations[moved])
        flat[moved] = to_hemispherical(turned.transpose(0, 2, 1), order).transpose(0, 2, 1)
    else:
        alpha, beta, gamma = euler_angles(rotations[moved])
        turned = rotate_about_z(flat[moved], gamma)
        tilted = np.flatnonzero(beta >= UPRIGHT)
        tilt = _tilt_precomputed if method == "precomputed" else _tilt_analytic
        turned[tilted] = tilt(turned[tilted], beta[tilted], order, angles)
        flat[moved] = rotate_about_z(turned, alpha)
    return flat.reshape(coefficients.shape)


def rotate_about_z(coefficients: F64, angle: F64 | float) -> F64:
    """Exact turn about z by angles (N,) or one; for both bases: coefficients (N, n²) or (N, n², C)."""
    m = degrees(order_of(coefficients.shape[1]))[1]
    place = np.arange(len(m))
    turn = m * np.reshape(angle, (-1, 1))
    extra = (1,) * (coefficients.ndim - 2)
    cosine, sine = np.cos(turn).reshape(-1, len(m), *extra), np.sin(turn).reshape(-1, len(m), *extra)
    return np.asarray(cosine * coefficients - sine * coefficients[:, place - 2 * m])


def euler_angles(rotation: F64) -> tuple[F64, F64, F64]:
    """(α, β, γ), float64 (N,) each, of R = R_z(α) R_y(β) R_z(γ), rotation (N, 3, 3); β in [0, π], γ = 0 where sin β vanishes."""
    sine = np.hypot(rotation[:, 0, 2], rotation[:, 1, 2])
    beta = np.arctan2(sine, rotation[:, 2, 2])  # arccos would lose half the digits at small angles
    upright = sine < 1e-7
    alpha = np.arctan2(rotation[:, 1, 2], rotation[:, 0, 2])
    # R_z(α) R_y(0) R_z(γ) turns by α + γ; R_y(π) mirrors x, hence both signs
    flip = np.where(rotation[:, 2, 2] < 0, -1.0, 1.0)
    alpha = np.where(upright, np.arctan2(flip * rotation[:, 1, 0], flip * rotation[:, 0, 0]), alpha)
    gamma = np.where(upright, 0.0, np.arctan2(rotation[:, 2, 1], -rotation[:, 2, 0]))
    return alpha, beta, gamma


def spherical_angle(beta: F64) -> F64:
    """β' with sin(β'/2) = √2 sin(β/2), that is cos β' = 2 cos β - 1: where the stretched sphere's pole goes, β in [0, π/2]."""
    if np.any(beta > QUARTER + 1e-12):
        raise ValueError("the analytic rotation is defined for tilts up to 90 degrees only")
    return np.asarray(2 * np.arcsin(np.minimum(1, np.sqrt(2) * np.sin(0.5 * beta))))


def _tilt_precomputed(coefficients: F64, beta: F64, order: int, angles: int) -> F64:
    turned = np.empty_like(coefficients)
    steep = np.flatnonzero(beta > QUARTER)
    for row in steep:
        turned[row] = rotation_matrix_y(float(beta[row]), order).T @ coefficients[row]
    rest = np.flatnonzero(beta <= QUARTER)
    if len(rest):
        turned[rest] = _apply_table("rotation", coefficients[rest], beta[rest], order, angles)
    return turned


def _tilt_analytic(coefficients: F64, beta: F64, order: int, angles: int) -> F64:
    stretched = spherical_angle(beta)
    kept = _apply_table("deletion", coefficients, np.minimum(beta, QUARTER), order, angles)
    return rotate_spherical(kept, np.stack([about_y(angle) for angle in stretched])) if len(beta) else kept


def _apply_table(kind: Literal["deletion", "rotation"], coefficients: F64, beta: F64, order: int, angles: int) -> F64:
    table = lune_table(kind, order, angles)
    lower, weight = table.place(beta)
    turned = np.empty_like(coefficients)

    def chunk(part: slice) -> None:
        for blocks, rows in ((table.even, table.even_rows), (table.odd, table.odd_rows)):
            _apply_transposed(blocks, rows, lower[part], weight[part], coefficients[part], turned[part])

    in_threads(chunk, chunks(len(beta), CHUNK))
    return turned


@numba.njit(nogil=True, cache=True)
def _apply_transposed(blocks: Any, rows: Any, lower: Any, weight: Any, coefficients: Any, out: Any) -> None:
    channels = coefficients.shape[2]
    for item in range(len(lower)):
        near, far, t = blocks[lower[item]], blocks[lower[item] + 1], weight[item]
        for j in rows:
            for c in range(channels):
                out[item, j, c] = 0.0
        for i in range(len(rows)):
            for j in range(len(rows)):
                entry = near[i, j] + t * (far[i, j] - near[i, j])
                for c in range(channels):
                    out[item, rows[j], c] += entry * coefficients[item, rows[i], c]
