"""Other bases of the hemisphere, to compare the accuracy of equally many coefficients.

| basis | definition | energy on the hemisphere |
| --- | --- | --- |
| hemispherical harmonics | `basis` | Σ f_i² |
| spherical harmonics | function 0 below the horizon, f_i = ∫_H f Y_i | Σ f_i², spread over the sphere |
| even spherical harmonics | function mirrored at the horizon, f_i = 2 ∫_H f Y_i for l + m even, no others | ½ Σ f_i² |
| Zernike | Koenderink & van Doorn 1998: Zernike polynomials of the disc √2 sin(θ/2) | Σ f_i² |

Share captured = that energy / ∫_H f² dω; where the basis is orthonormal on the hemisphere √(1 - share) is the relative L² error.
Even spherical harmonics and Zernike functions have no rotation or lighting product here: the former see light below the horizon.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_jacobi

from renderers.transport.hemispherical.basis import degrees, hemispherical_harmonics, spherical_harmonics
from renderers.transport.hemispherical.quadrature import Quadrature

F64 = NDArray[np.float64]
Basis = Literal["hemispherical", "spherical", "even", "zernike"]
BASES: tuple[Basis, ...] = get_args(Basis)


def orthonormal_values(basis: Basis, directions: F64, count: int) -> F64:
    """The first `count` functions at unit directions (Q, 3), z ≥ 0: (Q, count).

    Scaled so that Σ (∫_H f values)² is the captured energy."""
    if basis == "zernike":
        return zernike(directions, count)
    if basis == "even":
        return even_spherical_harmonics(directions, count)
    order = int(np.ceil(np.sqrt(count)))
    values = (hemispherical_harmonics if basis == "hemispherical" else spherical_harmonics)(directions, order)
    return values[:, :count]


def even_spherical_harmonics(directions: F64, count: int) -> F64:
    """√2 Y for the first `count` functions with l + m even, (Q, count): orthonormal on the hemisphere."""
    order = int(np.ceil((np.sqrt(8 * count + 1) - 1) / 2))
    degree, m = degrees(order)
    return np.asarray(np.sqrt(2) * spherical_harmonics(directions, order)[:, (degree + m) % 2 == 0][:, :count])


def zernike(directions: F64, count: int) -> F64:
    """The first `count` Zernike functions, k = 0, 1, … and m = -k, -k+2, … k, (Q, count): orthonormal on the hemisphere."""
    mu = directions[:, 2]
    radius = np.sqrt(np.maximum(0, 1 - mu))
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    values: list[F64] = []
    k = 0
    while len(values) < count:
        for m in range(-k, k + 1, 2):
            far = abs(m)
            polar = np.sqrt((k + 1) / (2 * np.pi)) * radius**far * eval_jacobi((k - far) // 2, far, 0, 2 * mu - 1)
            turn = np.sqrt(2) * (np.cos(m * phi) if m > 0 else np.sin(far * phi)) if m else 1.0
            values.append(polar * turn)
        k += 1
    return np.stack(values[:count], axis=1)


def captured(basis: Basis, values: F64, quadrature: Quadrature, count: int) -> float:
    """Share of the energy of a function, values (Q,) on a hemisphere quadrature, that the first `count` coefficients hold."""
    weighted = values * quadrature.weights
    coefficients = orthonormal_values(basis, quadrature.directions, count).T @ weighted
    return float(coefficients @ coefficients / (values @ weighted))
