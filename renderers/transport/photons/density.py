"""Irradiance and reflected radiance from a photon map by density estimation: k nearest or fixed radius; disc or hull areas.

    disc     E = Σ Φ / (π r²)
    hull     E = Σ Φ / A_H, and `corrected` A = A_H (n+1)/(n-v+1): see `hull`

The k-th of k nearest photons is left out everywhere: it sets the radius r_k, within which the k-1 others are uniform.

Radiance towards a viewer is Σ f_r(ω_i, v) Φ_i / A with each photon's own direction, so glossy surfaces show what lights them.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import Materials
from renderers.transport.kernels import shade
from renderers.transport.photons.hull import CORRECTED, DISC, HULL, sampled_area
from renderers.transport.photons.map import PhotonMap
from renderers.transport.photons.surface import curved
from renderers.transport.photons.tree import nearest, within

F64 = NDArray[np.float64]
Area = Literal["disc", "hull", "corrected"]
ESTIMATOR = {"disc": DISC, "hull": HULL, "corrected": CORRECTED}


FLAT_COS = 0.95
FLAT_SLAB, CURVED_SLAB, SLAB_FLOOR = 0.02, 0.25, 2e-4


class Lookup(NamedTuple):
    """How photons are gathered: the `nearest` ones within `radius`, or all within it (nearest = 0); area of what they sampled."""

    nearest: int
    radius: float
    estimator: int


class Points(NamedTuple):
    """Where to look: position, normal (unit) float64 (P, 3); slab (P,): accepted height over the tangent plane, in radii."""

    position: F64
    normal: F64
    slab: F64


def lookup(nearest: int = 50, radius: float = 0.1, area: Area = "disc") -> Lookup:
    """A Lookup; radius in World units (the scene's half diagonal is 1)."""
    return Lookup(nearest, radius, ESTIMATOR[area])


def points(world: World, position: NDArray[np.floating], normal: NDArray[np.floating], triangle: NDArray[np.integer]) -> Points:
    """Points (P, 3) on `triangle` (P,) of a World: on curved surfaces neighbours may leave the tangent plane, on flat ones not."""
    slab = np.where(curved(world)[triangle], CURVED_SLAB, FLAT_SLAB)
    return Points(np.ascontiguousarray(position, np.float64), np.ascontiguousarray(normal, np.float64), slab)


def irradiance(photons: PhotonMap, where: Points, how: Lookup) -> F64:
    """Irradiance at surface points, float64 (P, 3) in W·m⁻²."""
    out = np.zeros((len(where.position), 3))
    _irradiance(photons.tree, photons.photons.flux, *where, how, out)
    return out


def reflected(photons: PhotonMap, where: Points, views: F64, materials: Materials, how: Lookup) -> F64:
    """Radiance that surface points reflect towards unit `views` (P, 3), float64 (P, 3); exact BRDFs."""
    out = np.zeros((len(where.position), 3))
    p = photons.photons
    _reflected(photons.tree, p.flux, p.direction, *where, np.ascontiguousarray(views, np.float64), *materials, how, out)
    return out


@numba.njit(nogil=True, cache=True)
def gathered(tree, p, n, slab, how):  # type: ignore[no-untyped-def]
    """(rows, area): photons whose summed flux over `area` is the irradiance at p; no rows and 0 where there are none."""
    height = slab * how.radius + SLAB_FLOOR
    k = how.nearest
    if k == 0:
        rows, count = within(tree, p, n, how.radius, FLAT_COS, height, np.empty(256, np.int64))
        radius2 = how.radius * how.radius
    else:
        rows, distances2 = np.empty(k, np.int64), np.empty(k)
        count = nearest(tree, p, n, how.radius, FLAT_COS, height, rows, distances2)
        radius2 = distances2[0] if count == k else how.radius * how.radius
    if count == 0 or radius2 == 0.0:
        return rows[:0], 0.0
    first = 1 if k > 1 and count == k else 0  # rows[0], the farthest, set the radius: the others are uniform within it
    rows = rows[first:count]
    if how.estimator == DISC:
        return rows, np.pi * radius2
    return rows, projected_area(tree, p, n, rows, len(rows), np.sqrt(radius2), how.estimator)


@numba.njit(nogil=True, cache=True)
def projected_area(tree, p, n, rows, count, radius, estimator):  # type: ignore[no-untyped-def]
    """Area of the photons' positions in the tangent plane, coordinates relative to p."""
    sign = 1.0 if n[2] >= 0 else -1.0
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    x, y = np.empty(count), np.empty(count)
    for j in range(count):
        dx, dy, dz = (
            tree.positions[rows[j], 0] - p[0],
            tree.positions[rows[j], 1] - p[1],
            tree.positions[rows[j], 2] - p[2],
        )
        x[j] = dx * (1 + sign * n[0] * n[0] * a) + dy * sign * b - dz * sign * n[0]
        y[j] = dx * b + dy * (sign + n[1] * n[1] * a) - dz * n[1]
    return sampled_area(x, y, count, radius, estimator)


@numba.njit(parallel=True, cache=True)
def _irradiance(tree, flux, positions, normals, slabs, how, out):  # type: ignore[no-untyped-def]
    for i in numba.prange(len(positions)):
        rows, area = gathered(tree, positions[i], normals[i], slabs[i], how)
        for j in rows:
            for c in range(3):
                out[i, c] += flux[j, c] / area


@numba.njit(parallel=True, cache=True)
def _reflected(tree, flux, came, positions, normals, slabs, views, kind, base, specular, exponent, metallic, alpha, how, out):  # type: ignore[no-untyped-def]
    for i in numba.prange(len(positions)):
        rows, area = gathered(tree, positions[i], normals[i], slabs[i], how)
        n = (normals[i, 0], normals[i, 1], normals[i, 2])
        v = (views[i, 0], views[i, 1], views[i, 2])
        weight, total = np.empty(3), np.zeros(3)
        for j in rows:
            # the flux carries the cosine of arrival already: radiance is Σ f Φ / A
            for c in range(3):
                weight[c] = flux[j, c] / area
            if kind[i] == LAMBERT:
                for c in range(3):
                    total[c] += base[i, c] / np.pi * weight[c]
            else:
                light = (float(came[j, 0]), float(came[j, 1]), float(came[j, 2]))
                shade(kind[i], base[i], specular[i], exponent[i], metallic[i], alpha[i], n, v, light, weight, total)
        for c in range(3):
            out[i, c] = total[c]
