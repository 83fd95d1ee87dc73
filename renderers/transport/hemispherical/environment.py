"""Environment lighting: a map projected once onto spherical harmonics lights any number of points.

    s = ∫ L Y dω in world axes  →  s' = D(F) s in the point's frame (rows t, b, n)  →  h = C s'  →  L_o = Σ_i h_i c_i(ω_o)

Gautron 2006, section 3.4. The result is ∫_H (f truncated to order n) (L truncated to order N) dω: the environment's order decides
about sharpness. No shadows: everything above the horizon counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.environment import checked_image, radiance
from renderers.scene.model import Environment
from renderers.scene.transforms import rotation_matrix
from renderers.transport.hemispherical.basis import spherical_harmonics
from renderers.transport.hemispherical.conversion import to_hemispherical
from renderers.transport.hemispherical.quadrature import gauss_legendre
from renderers.transport.hemispherical.sphere_rotation import rotate_spherical

F64 = NDArray[np.float64]


def project_environment(environment: Environment, order: int) -> F64:
    """Spherical coefficients (order², 3) of the environment in world axes, by 2×2 nodes in each cell of the image."""
    result = np.zeros((order**2, 3))
    if environment.image is None:
        result[0] = np.sqrt(4 * np.pi) * np.asarray(environment.radiance)
        return result
    height, width = checked_image(environment.image).shape[:2]
    to_world = rotation_matrix(environment.rotation)
    cell = np.arange(width)[:, None] + gauss_legendre(2, 0, 1)[0]
    phi = 2 * np.pi * (cell.ravel() + 0.5) / width
    share = np.pi / width  # half a column: two equal nodes
    for row in range(height - 1):
        polar, weights = gauss_legendre(2, np.pi * row / (height - 1), np.pi * (row + 1) / (height - 1))
        for theta, weight in zip(polar, weights, strict=True):
            sine = np.sin(theta)
            local = np.stack([sine * np.sin(phi), np.full_like(phi, np.cos(theta)), -sine * np.cos(phi)], axis=1)
            directions = local @ to_world.T
            values = radiance(environment, directions)
            result += spherical_harmonics(directions, order).T @ (values * (weight * sine * share))
    return result


def incoming(spherical: F64, frames: F64, order: int) -> F64:
    """Hemispherical coefficients (N, order², 3) of the environment (M², 3) above points with frames (N, 3, 3), rows t, b, n."""
    turned = rotate_spherical(np.broadcast_to(spherical, (len(frames), *spherical.shape)), frames)
    return np.asarray(to_hemispherical(turned.transpose(0, 2, 1), order).transpose(0, 2, 1))
