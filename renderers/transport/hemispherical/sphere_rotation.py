"""Rotation of spherical harmonics: g(ω) = f(Rᵀω) becomes g = D(R) f, block diagonal by degree and orthogonal.

The blocks follow from the 3×3 rotation by recursion over degrees (Ivanic & Ruedenberg 1996, with their correction of 1998). That
recursion has no Condon–Shortley sign, so coefficients are multiplied by (-1)^m before and after.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import degrees, order_of
from renderers.transport.threads import chunks, in_threads

F64 = NDArray[np.float64]
CHUNK = 64


def rotate_spherical(coefficients: F64, rotation: F64) -> F64:
    """D(R) f: coefficients float64 (N, n²) or (N, n², C), rotation (N, 3, 3) or one (3, 3); same shape as the coefficients."""
    order = order_of(coefficients.shape[1])
    sign = 1.0 - 2.0 * (degrees(order)[1] % 2)
    channels = math.prod(coefficients.shape[2:])
    signed = (coefficients.reshape(*coefficients.shape[:2], channels) * sign[:, None]).astype(np.float64)
    rotations = np.ascontiguousarray(np.broadcast_to(rotation, (len(signed), 3, 3)), np.float64)
    turned: F64 = np.empty_like(signed)
    in_threads(lambda part: _rotate(rotations[part], signed[part], turned[part]), chunks(len(signed), CHUNK))
    return np.asarray(turned * sign[:, None]).reshape(coefficients.shape)


def spherical_rotation_matrix(rotation: F64, order: int) -> F64:
    """D(R), float64 (order², order²), of one rotation (3, 3)."""
    return np.asarray(rotate_spherical(np.eye(order**2)[None], rotation)[0])


@numba.njit(nogil=True, cache=True)
def _rotate(rotations: Any, coefficients: Any, out: Any) -> None:
    order = round(np.sqrt(coefficients.shape[1]))
    channels = coefficients.shape[2]
    width = 2 * order - 1
    older, newer, first = np.zeros((width, width)), np.zeros((width, width)), np.zeros((3, 3))
    axis = (1, 2, 0)  # y, z, x are the functions m = -1, 0, 1
    for item in range(len(rotations)):
        for i in range(3):
            for j in range(3):
                first[i, j] = rotations[item, axis[i], axis[j]]
        newer[0, 0] = 1.0
        for degree in range(order):
            if degree == 1:
                newer[:3, :3] = first
            elif degree > 1:
                older, newer = newer, older
                _next_block(first, older, degree, newer)
            start = degree * degree
            for i in range(2 * degree + 1):
                for c in range(channels):
                    total = 0.0
                    for j in range(2 * degree + 1):
                        total += newer[i, j] * coefficients[item, start + j, c]
                    out[item, start + i, c] = total


@numba.njit(nogil=True, cache=True)
def _next_block(first: Any, block: Any, degree: int, out: Any) -> None:
    """The block of `degree` from that of degree - 1; rows and columns are m + degree, and m + degree - 1 in `block`."""
    for m in range(-degree, degree + 1):
        for k in range(-degree, degree + 1):
            total = (degree + k) * (degree - k) if abs(k) < degree else 2 * degree * (2 * degree - 1)
            centre = 1 if m == 0 else 0
            far = abs(m)
            value = 0.0
            if far < degree:
                value += np.sqrt((degree + m) * (degree - m) / total) * _product(first, block, degree, 0, m, k)
            v = 0.5 * np.sqrt((1 + centre) * (degree + far - 1) * (degree + far) / total) * (1 - 2 * centre)
            value += v * _neighbour_below(first, block, degree, m, k)
            if m != 0 and far < degree - 1:
                w = -0.5 * np.sqrt((degree - far - 1) * (degree - far) / total)
                value += w * _neighbour_above(first, block, degree, m, k)
            out[m + degree, k + degree] = value


@numba.njit(nogil=True, cache=True)
def _product(first: Any, block: Any, degree: int, i: int, m: int, k: int) -> Any:
    """The paper's P_i(m, k): row i of the rotation times row m of the block."""
    row, last = m + degree - 1, 2 * degree - 2
    if k == degree:
        return first[i + 1, 2] * block[row, last] - first[i + 1, 0] * block[row, 0]
    if k == -degree:
        return first[i + 1, 2] * block[row, 0] + first[i + 1, 0] * block[row, last]
    return first[i + 1, 1] * block[row, k + degree - 1]


@numba.njit(nogil=True, cache=True)
def _neighbour_below(first: Any, block: Any, degree: int, m: int, k: int) -> Any:
    """The paper's V."""
    if m == 0:
        return _product(first, block, degree, 1, 1, k) + _product(first, block, degree, -1, -1, k)
    if m > 0:
        value = _product(first, block, degree, 1, m - 1, k) * (np.sqrt(2.0) if m == 1 else 1.0)
        return value if m == 1 else value - _product(first, block, degree, -1, 1 - m, k)
    value = _product(first, block, degree, -1, -m - 1, k) * (np.sqrt(2.0) if m == -1 else 1.0)
    return value if m == -1 else value + _product(first, block, degree, 1, m + 1, k)


@numba.njit(nogil=True, cache=True)
def _neighbour_above(first: Any, block: Any, degree: int, m: int, k: int) -> Any:
    """The paper's W, for m ≠ 0."""
    if m > 0:
        return _product(first, block, degree, 1, m + 1, k) + _product(first, block, degree, -1, -m - 1, k)
    return _product(first, block, degree, 1, m - 1, k) - _product(first, block, degree, -1, 1 - m, k)
