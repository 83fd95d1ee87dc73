"""Real hemispherical harmonics H and spherical harmonics Y, by a normalised recurrence without factorials.

    H_l^m(θ, φ) = √2 K̃ P̃_l^|m|(cos θ) {cos mφ, 1/√2, sin |m|φ} for m > 0, = 0, < 0
    P̃_l^m(μ) = P_l^m(2μ - 1),  K̃² = (2l+1)(l-|m|)! / (2π (l+|m|)!)                           Gautron 2006, section 3.2
    Y_l^m the same with P_l^m(cos θ) and K² = K̃²/2                                            orthonormal on the sphere

Since μ → 2μ - 1 maps the hemisphere onto the sphere and doubles areas, H(μ, φ) = √2 Y(2μ - 1, φ), orthonormal on the hemisphere.

The recurrence runs over polynomials in x = 2μ - 1 (or x = μ); the factor (sin θ' e^{iφ})^m is a complex power. With
sin θ' = 2√(μ(1-μ)) = 2√(μ/(1+μ)) sin θ it is (2√(μ/(1+μ)) (d_x + i d_y))^m, which needs neither φ nor 1 - μ: no special case at the
pole and no cancellation near it. float32 directions are worked on in float64 and the results rounded: it costs no speed here.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.threads import chunks, in_threads

F64 = NDArray[np.float64]
Float = TypeVar("Float", bound=np.floating[Any])

HORIZON = 1e-3  # directions this far below the horizon are rounding of horizontal ones; lower ones are an error
CHUNK = 1 << 13


def index(degree: int, m: int) -> int:
    """Place l(l+1) + m of the function of degree l ≥ 0 and -l ≤ m ≤ l. Raises ValueError elsewhere."""
    if not abs(m) <= degree:
        raise ValueError(f"there is no function of degree {degree} with m = {m}")
    return degree * (degree + 1) + m


def degrees(order: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(l, m) of each coefficient, int64 (order²,) each."""
    _checked_order(order)
    places = np.arange(order * order)
    degree = np.repeat(np.arange(order), 2 * np.arange(order) + 1)
    return degree, places - degree * (degree + 1)


def order_of(count: int) -> int:
    """The order whose number of coefficients is `count`. Raises ValueError if `count` is no positive square."""
    order = math.isqrt(max(count, 0))
    if order < 1 or order * order != count:
        raise ValueError(f"{count} is not a number of coefficients: those are 1, 4, 9, ...")
    return order


def directions_of(mu: NDArray[Float], phi: NDArray[Float]) -> NDArray[Float]:
    """Unit directions (..., 3) of cosines mu, clamped to [-1, 1], and azimuths phi (broadcast together)."""
    mu = np.clip(mu, -1, 1)
    r = np.sqrt((1 - mu) * (1 + mu))
    return np.stack(np.broadcast_arrays(r * np.cos(phi), r * np.sin(phi), mu), axis=-1)


def hemispherical_harmonics(directions: NDArray[Float], order: int) -> NDArray[Float]:
    """All H of an order at unit local directions (..., 3): (..., order²) in sr^-½, float32 or float64 as the directions.

    z is clamped to [0, 1]. Raises ValueError below the horizon (z < -1e-3) and for NaN.
    """
    flat = np.ascontiguousarray(directions).reshape(-1, 3)
    if flat.size and not flat[:, 2].min() >= -HORIZON:
        raise ValueError("hemispherical harmonics are defined on the upper hemisphere only (z >= 0)")
    return _evaluated(flat, order, True).reshape(*directions.shape[:-1], order * order)


def spherical_harmonics(directions: NDArray[Float], order: int) -> NDArray[Float]:
    """All Y of an order at unit directions (..., 3): (..., order²) in sr^-½, float32 or float64 as the directions."""
    flat = np.ascontiguousarray(directions).reshape(-1, 3)
    return _evaluated(flat, order, False).reshape(*directions.shape[:-1], order * order)


def polar_parts(x: F64, order: int, m: int, norm: float) -> F64:
    """Normalised P_l^m(x) for l = m … order-1, float64 (len(x), order-m), times norm · √(2π): norm is the value of degree 0."""
    sine = np.sqrt(np.maximum(0, (1 - x) * (1 + x)))
    diagonal, upward, downward = _recurrence(order)
    newer = norm * np.prod(diagonal[1 : m + 1]) * sine**m
    older, parts = np.zeros_like(x), [newer]
    for degree in range(m + 1, order):
        older, newer = newer, upward[m, degree] * x * newer - downward[m, degree] * older
        parts.append(newer)
    return np.stack(parts, axis=1)


@lru_cache(maxsize=64)
def _recurrence(order: int) -> tuple[F64, F64, F64]:
    """diagonal (n,): P_m^m / P_{m-1}^{m-1} / sin θ'; upward, downward (n, n) [m, l]: q_l = upward x q_{l-1} - downward q_{l-2}."""
    degree = np.arange(order, dtype=np.float64)
    m = degree[:, None]
    diagonal = np.concatenate([[1.0], -np.sqrt((2 * degree[1:] + 1) / (2 * degree[1:]))])
    above = degree > m
    upward = np.sqrt(np.where(above, 4 * degree**2 - 1, 0) / np.where(above, degree**2 - m**2, 1))
    below = np.maximum(0, (degree - 1) ** 2 - m**2) / np.where(above, np.abs(4 * (degree - 1) ** 2 - 1), 1)
    return diagonal, upward, upward * np.sqrt(below)


def _evaluated(directions: NDArray[Float], order: int, hemisphere: bool) -> NDArray[Float]:
    _checked_order(order)
    if directions.dtype not in (np.float32, np.float64):
        raise ValueError(f"directions must be float32 or float64, got {directions.dtype}")
    values = np.empty((len(directions), order * order), directions.dtype)
    in_threads(
        lambda part: _evaluate(directions[part], *_recurrence(order), hemisphere, values[part]),
        chunks(len(directions), CHUNK),
    )
    return values


@numba.njit(nogil=True, cache=True)
def _evaluate(directions: Any, diagonal: Any, upward: Any, downward: Any, hemisphere: bool, out: Any) -> None:
    start = (1 / np.sqrt(2 * np.pi)) if hemisphere else (1 / np.sqrt(4 * np.pi))
    for i in range(len(directions)):
        u, v, x = np.float64(directions[i, 0]), np.float64(directions[i, 1]), np.float64(directions[i, 2])
        if hemisphere:
            mu = np.float64(min(max(x, 0.0), 1.0))
            stretch = 2 * np.sqrt(mu / (1 + mu))
            u, v, x = u * stretch, v * stretch, 2 * mu - 1
        real, imaginary = 1.0, 0.0
        first = np.float64(start)
        for m in range(len(diagonal)):
            if m > 0:
                real, imaginary = real * u - imaginary * v, real * v + imaginary * u
                first *= diagonal[m] * (np.sqrt(2.0) if m == 1 else 1.0)
            older, newer = 0.0, first
            for degree in range(m, len(diagonal)):
                if degree > m:
                    older, newer = newer, upward[m, degree] * x * newer - downward[m, degree] * older
                middle = degree * (degree + 1)
                out[i, middle + m] = real * newer
                if m > 0:
                    out[i, middle - m] = imaginary * newer


def _checked_order(order: int) -> None:
    if order < 1:
        raise ValueError(f"the order must be at least 1, got {order}")
