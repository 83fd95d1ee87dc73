"""Coefficients of functions on the hemisphere, and back.

    f_i = ∫_H f H_i dω       f ≈ Σ_i f_i H_i       ∫_H f g dω ≈ Σ_i f_i g_i

The product's error is the product of both truncation errors, so it is small as soon as one factor is smooth. Of a
lighting product ∫ L f_r cos θ dω exactly one factor must hold the cosine: here the BRDF's (`brdf_table`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import directions_of, hemispherical_harmonics, order_of
from renderers.transport.hemispherical.quadrature import Quadrature, gauss_legendre

F64 = NDArray[np.float64]
Face = Literal["top", "+x", "+y", "-x", "-y"]
FACES: tuple[Face, ...] = ("top", "+x", "+y", "-x", "-y")
GAUSS = 3  # nodes a side in each pixel


class Pixels(NamedTuple):
    """Quadrature nodes of the pixels of a hemisphere image: directions float64 (P, K, 3), weights (P, K) in sr, row-major P."""

    directions: F64
    weights: F64


def project(values: F64, quadrature: Quadrature, order: int) -> F64:
    """Coefficients (order²,) or (order², C) of a function with values (Q,) or (Q, C) at the quadrature's directions."""
    weighted = values * quadrature.weights.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray(hemispherical_harmonics(quadrature.directions, order).T @ weighted)


def project_samples(values: F64, directions: F64, pdf: F64, order: int) -> F64:
    """Monte Carlo: coefficients of values (S,) or (S, C) at random directions (S, 3) of density pdf (S,) > 0 per sr; unbiased."""
    return project(values, Quadrature(directions, 1 / (len(pdf) * pdf)), order)


def project_image(image: F64, weights: F64) -> F64:
    """Coefficients (order²,) or (order², C) of an image (…, C) or (…): weights (P, order²) from `image_weights`, P pixels."""
    count = len(weights)
    channels = image.shape[-1:] if image.size != count else ()
    return np.asarray(weights.T @ image.reshape(count, *channels))


def image_weights(pixels: Pixels, order: int) -> F64:
    """∫_pixel H_i dω, float64 (P, order²): radiance is taken as constant in each pixel."""
    values = hemispherical_harmonics(pixels.directions, order)
    return np.asarray(np.einsum("pk,pki->pi", pixels.weights, values))


def polar_pixels(rows: int, columns: int) -> Pixels:
    """Image (rows, columns): row 0 at the pole, rows of equal solid angle, column k spans φ in [k, k+1]·2π/columns."""
    offset, share = gauss_legendre(GAUSS, 0, 1)
    mu = 1 - (np.arange(rows)[:, None] + offset) / rows
    phi = 2 * np.pi * (np.arange(columns)[:, None] + offset) / columns
    directions = directions_of(mu[:, None, :, None], phi[None, :, None, :])
    weights = np.broadcast_to(np.outer(share, share) * (2 * np.pi / (rows * columns)), directions.shape[:-1])
    return _flat(directions, weights)


def plane_pixels(size: int, half_width: float) -> Pixels:
    """Image (size, size) on the plane z = 1, |x|, |y| ≤ half_width: row 0 at +y, column 0 at -x. Part of the hemisphere."""
    edges = np.linspace(-half_width, half_width, size + 1)
    x, x_weights = _gauss_cells(edges)
    return _perspective("top", x, x[::-1, ::-1], x_weights, x_weights)


@lru_cache(maxsize=8)
def hemicube_pixels(size: int) -> Pixels:
    """Images in the order of FACES: top (size, size) as `plane_pixels(size, 1)`, then the sides' upper halves (size/2, size).

    Sides have row 0 on top, columns from left to right as seen from the centre; together they cover the hemisphere. size is even.
    """
    if size < 2 or size % 2:
        raise ValueError(f"the size of a hemicube must be even, got {size}")
    x, x_weights = _gauss_cells(np.linspace(-1, 1, size + 1))
    height, height_weights = x[size // 2 :], x_weights[size // 2 :]
    faces = [_perspective("top", x, x[::-1, ::-1], x_weights, x_weights)]
    faces += [_perspective(face, x, height[::-1, ::-1], x_weights, height_weights) for face in FACES[1:]]
    return Pixels(np.concatenate([face.directions for face in faces]), np.concatenate([face.weights for face in faces]))


def reconstruct(coefficients: F64, directions: F64) -> F64:
    """Σ_i f_i H_i at directions (..., 3): (...) for coefficients (n²,), (..., C) for (n², C). May ring below 0: see `clamped`."""
    return np.asarray(hemispherical_harmonics(directions, order_of(len(coefficients))) @ coefficients)


def product(first: F64, second: F64) -> F64:
    """Σ_i of two coefficient arrays (..., n², C) and (..., n², 1 or C), that is ∫_H f g dω of their series, (..., C)."""
    return np.asarray(np.einsum("...ic,...ic->...c", *np.broadcast_arrays(first, second)))


def clamped(radiance: F64) -> tuple[F64, int]:
    """(max(0, radiance), how many values were negative): truncated series ring, radiance mustn't be negative."""
    return np.maximum(radiance, 0), int(np.count_nonzero(radiance < 0))


def irradiance(coefficients: F64) -> F64:
    """∫ L cos θ dω of incoming radiance (n², ...), n ≥ 2: exact, from two coefficients: √(π/2) λ_00 + √(π/6) λ_10."""
    if len(coefficients) < 4:
        raise ValueError("irradiance needs order 2 at least")
    return np.asarray(np.sqrt(np.pi / 2) * coefficients[0] + np.sqrt(np.pi / 6) * coefficients[2])


def _gauss_cells(edges: F64) -> tuple[F64, F64]:
    """Nodes and weights (cells, GAUSS) between successive edges."""
    offset, share = gauss_legendre(GAUSS, 0, 1)
    width = np.diff(edges)[:, None]
    return edges[:-1, None] + width * offset, width * share


def _perspective(face: Face, right: F64, up: F64, right_weights: F64, up_weights: F64) -> Pixels:
    """Pixels of a plane at unit distance; right (W, K), up (H, K) coordinates on it."""
    a, b = np.broadcast_arrays(right[None, :, None, :], up[:, None, :, None])
    one = np.ones_like(a)
    axes = {"top": (a, b, one), "+x": (one, -a, b), "+y": (a, one, b), "-x": (-one, a, b), "-y": (-a, -one, b)}
    directions = np.stack(axes[face], axis=-1)
    distance = np.linalg.norm(directions, axis=-1)
    weights = up_weights[:, None, :, None] * right_weights[None, :, None, :] / distance**3
    return _flat(directions / distance[..., None], weights)


def _flat(directions: F64, weights: F64) -> Pixels:
    rows, columns, down, across = weights.shape
    return Pixels(directions.reshape(rows * columns, down * across, 3), weights.reshape(rows * columns, down * across))
