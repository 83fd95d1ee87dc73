"""BRDF lobes in the local frame (z = normal) that the accuracy figures of the literature use, and which of them an order can hold.

    Phong   k_s (e+2)/(2π) max(0, r·o)ᵉ, r the mirror of the incoming direction about z
    Ward    k_d/π + k_s exp(-((h_x/α_x)² + (h_y/α_y)²)/h_z²) / (4π α_x α_y √(cos θ_i cos θ_o))       Ward 1992, anisotropic

A BRDF here is any function of light (Q, 3), unit directions, and view (3,), giving (Q,) or (Q, C) values in 1/sr.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from renderers.transport import brdf
from renderers.transport.brdf import Materials

F64 = NDArray[np.float64]
Brdf = Callable[[F64, F64], F64]

GRAZING = 1e-9  # cosines under this are taken as this: Ward's model is infinite at the horizon
SMALLEST_ORDER = ((5.0, 5), (15.0, 8), (20.0, 9))  # exponents up to the first number need the second: about 1 % error or less


def phong(exponent: float, specular: float = 1.0) -> Brdf:
    """The Phong lobe, normalised so that k_s = `specular` is its largest albedo."""

    def evaluate(light: F64, view: F64) -> F64:
        mirrored = np.array([-view[0], -view[1], view[2]])
        return np.asarray(specular * brdf.phong_lobe(exponent, light @ mirrored))

    return evaluate


def ward(alpha_x: float, alpha_y: float, specular: float = 1.0, diffuse: float = 0.0) -> Brdf:
    """Ward's anisotropic model."""

    def evaluate(light: F64, view: F64) -> F64:
        half = light + view
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), GRAZING)
        slope = ((half[:, 0] / alpha_x) ** 2 + (half[:, 1] / alpha_y) ** 2) / np.maximum(half[:, 2], GRAZING) ** 2
        cosines = np.maximum(light[:, 2], GRAZING) * max(float(view[2]), GRAZING)
        return np.asarray(diffuse / np.pi + specular * np.exp(-slope) / (4 * np.pi * alpha_x * alpha_y * np.sqrt(cosines)))

    return evaluate


def of_material(material: Materials) -> Brdf:
    """The RGB BRDF (Q, 3) of the first row of `material`: Lambert, Phong or GGX."""
    row = material.rows(np.zeros(1, np.intp))

    def evaluate(light: F64, view: F64) -> F64:
        normal = np.broadcast_to([0.0, 0.0, 1.0], light.shape)
        many = row.rows(np.zeros(len(light), np.intp))
        return brdf.evaluate(many, normal, light, np.broadcast_to(view, light.shape))

    return evaluate


def order_for(exponent: float) -> int | None:
    """Smallest order that holds a cosine-weighted Phong lobe of this exponent to about 2 % of the mean, None above exponent 20.

    A surface with None is too shiny for the basis and belongs to importance sampling: at exponent 50 order 10 misses
    14 % of the lobe (L²).
    """
    return next((order for largest, order in SMALLEST_ORDER if exponent <= largest), None)
