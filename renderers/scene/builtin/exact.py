"""Exact answers of the closed-form scenes, from vector irradiance of polygons and from flux balances. All in scene units."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]


def polygon_irradiance(points: ArrayLike, normal: ArrayLike, corners: ArrayLike, radiance: float = 1.0) -> F64:
    """Irradiance (...,) at points (..., 3) with unit `normal` (3,) from a convex Lambertian polygon (K, 3) of `radiance`.

    Lambert's formula E = L/2 · Σ Θ_i (Γ_i·n), Θ_i the angle under which edge i is seen, Γ_i the unit normal of the plane through it
    and the point. The polygon must lie in the upper half space of each point (touching the horizon is allowed); its side doesn't
    matter.
    """
    vertices = np.asarray(corners, np.float64) - np.asarray(points, np.float64)[..., None, :]
    after = np.roll(vertices, -1, axis=-2)
    cross = np.cross(vertices, after)
    length = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(length, (vertices * after).sum(axis=-1))
    # an edge in line with the point subtends no area: its term is 0, whatever the direction of the null vector
    gamma = (cross @ np.asarray(normal, np.float64)) / np.where(length > 0, length, 1.0)
    return np.asarray(np.abs((angle * gamma).sum(axis=-1)) * radiance / 2)


def rectangle_irradiance(
    points: ArrayLike, width: float = 1.0, depth: float = 0.6, height: float = 1.0, radiance: float = 1.0, occluder: float = 0.0
) -> F64:
    """Irradiance (...,) on the floor y = 0 of `rectangle-light` at points (..., 3), without and with its square black occluder.

    Seen from a floor point the occluder at half height covers the rectangle p + 2 (occluder - p) of the light's plane; what is left
    is the light minus its intersection with that rectangle, both axis-aligned, each with Lambert's formula.
    """
    p = np.asarray(points, np.float64)
    half = np.array([width / 2, depth / 2])
    full = polygon_irradiance(p, (0, 1, 0), _level(-half, half, height), radiance)
    if not occluder:
        return full
    low = np.clip(-occluder - p[..., [0, 2]], -half, half)
    high = np.clip(occluder - p[..., [0, 2]], -half, half)
    hidden = polygon_irradiance(p, (0, 1, 0), _level(low, high, height), radiance)
    return np.asarray(full - hidden)


def _level(low: F64, high: F64, y: float) -> F64:
    """Corners (..., 4, 3) of the rectangle low..high (x, z) at height y."""
    x0, z0, x1, z1 = low[..., 0], low[..., 1], high[..., 0], high[..., 1]
    level = np.full_like(x0, y)
    return np.stack([np.stack([x, level, z], axis=-1) for x, z in ((x0, z0), (x1, z0), (x1, z1), (x0, z1))], axis=-2)


def parallel_plates_form_factor(side: float, distance: float) -> float:
    """Form factor between two directly opposed squares (Howell, Catalog of Configuration Factors, C-11), X = side / distance.

    F = 2/(πX²) · [ln((1+X²)/√(1+2X²)) + 2X√(1+X²)·atan(X/√(1+X²)) - 2X·atan X]
    """
    x = side / distance
    root = np.sqrt(1 + x * x)
    log = np.log((1 + x * x) / np.sqrt(1 + 2 * x * x))
    return float(2 / (np.pi * x * x) * (log + 2 * x * root * np.arctan(x / root) - 2 * x * np.arctan(x)))


def parallel_plates_irradiance(points: ArrayLike, side: float = 1.0, distance: float = 1.0, radiance: float = 1.0) -> F64:
    """Irradiance (...,) on the lower plate (y = 0) of `parallel-plates` at points (..., 3); the upper one has `radiance`."""
    half = np.array([side / 2, side / 2])
    return polygon_irradiance(points, (0, 1, 0), _level(-half, half, distance), radiance)


def corner_irradiance(points: ArrayLike, angle: float = 90.0, side: float = 1.0, radiance: float = 1.0) -> F64:
    """Irradiance (...,) on the floor of `corner` (y = 0, 0 ≤ z ≤ side) at points (..., 3) from its wall of uniform radiance."""
    y, z = side * np.sin(np.radians(angle)), side * np.cos(np.radians(angle))
    h = side / 2
    return polygon_irradiance(points, (0, 1, 0), [(-h, 0, 0), (h, 0, 0), (h, y, z), (-h, y, z)], radiance)


def furnace_radiance(albedo: float, emission: float = 1.0) -> float:
    """Radiance everywhere in a closed enclosure of uniform albedo and emission: L = e + a·L, so L = e / (1 - a)."""
    return emission / (1 - albedo)


def enclosed_sphere_irradiance(
    inner: float = 0.3, outer: float = 1.0, albedo: float = 0.5, radiance: float = 1.0, bounces: int | None = None
) -> float:
    """Irradiance on the outer sphere around a black concentric sphere of `radiance`; bounces 0 is direct light, None all of them.

    k = (inner/outer)² is the form factor from outer to inner, 1 - k that from outer to itself, so E_0 = π·L·k and each bounce
    multiplies by q = albedo·(1 - k): E_n = E_0 (1 + q + … + qⁿ), E_∞ = E_0 / (1 - q).
    """
    k = (inner / outer) ** 2
    return _series(np.pi * radiance * k, albedo * (1 - k), bounces)


def integrating_sphere_irradiance(
    outer: float = 1.0, albedo: float = 0.5, intensity: float = 1.0, bounces: int | None = None
) -> float:
    """Irradiance on a closed sphere around a point light: E_0 = intensity / outer², every bounce multiplies by the albedo."""
    return _series(intensity / outer**2, albedo, bounces)


def _series(first: float, ratio: float, bounces: int | None) -> float:
    return first / (1 - ratio) if bounces is None else first * sum(ratio**n for n in range(bounces + 1))
