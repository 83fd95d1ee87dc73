"""Irradiance records from photons alone (Gautron 2006, algorithm 7): zone, irradiance and gradients of many places at once.

1  the K nearest photons that pass the surface filter: h, the harmonic mean of the ways they came; R = clamp(h), r = aR
2  all filtered photons within r (r grows while there are fewer than n_min): h again, R = clamp(h, R/2, 2R)
3  A, the area they sampled (`hull`); E = Σ Φ / A without the photon on which the record sits
4  gradients from hemisphere cells (`cells`), limited to |∇_p| ≤ E/R

In scenes with curved surfaces a zone that grows takes in tilted photons as well, √(1 - n·n_i) ≤ a (r/aR) as in the cache's own
metric: a wider zone of the same column, not a patch of the next one. There A is counted, where it is `corrected` (`surface`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.photons.cells import NOISE, cell_sums, gradients_of, shrink
from renderers.transport.photons.density import FLAT_COS, SLAB_FLOOR, Points
from renderers.transport.photons.hull import CORRECTED, area_and_vertices
from renderers.transport.photons.surface import measured_area
from renderers.transport.photons.tree import nearest, within

if TYPE_CHECKING:
    from renderers.transport.photons.map import PhotonMap

OFF, THRESHOLDED, SHRUNK = 0, 1, 2
GRADIENTS = {"off": OFF, "thresholded": THRESHOLDED, "shrunk": SHRUNK}
NEAREST_WAY = 2e-4
GROWTH = 1.25
WIDEST = 0.95  # of √(1 - n·n_i): photons of surfaces at right angles never count


class Recipe(NamedTuple):
    """How records are made.

    a: accuracy; smallest, largest: limits of R, World units; knn = K; n_min; estimator: see `hull`; gradients: OFF, THRESHOLDED or
    SHRUNK; n_grad; rows, columns: hemisphere cells.
    """

    a: float
    smallest: float
    largest: float
    knn: int
    n_min: int
    estimator: int
    gradients: int
    n_grad: int
    rows: int
    columns: int


class Zones(NamedTuple):
    """Records of C places, and what they were made from.

    radius R (C,), irradiance (C, 3), translation, rotation (C, 3, 3) [channel, component], float64; photons int64 (C,): how many
    the zone holds; reach (C,), its radius r; cosine (C,): its photons' normals are within; area (C,); vertices int64 (C,) of the
    hull, 0 where there is none.
    """

    radius: NDArray[np.float64]
    irradiance: NDArray[np.float64]
    translation: NDArray[np.float64]
    rotation: NDArray[np.float64]
    photons: NDArray[np.int64]
    reach: NDArray[np.float64]
    cosine: NDArray[np.float64]
    area: NDArray[np.float64]
    vertices: NDArray[np.int64]

    @staticmethod
    def empty(count: int) -> Zones:
        """Room for `count` records."""
        f, i = np.zeros(count), np.zeros(count, np.int64)
        gradient = np.zeros((count, 3, 3))
        return Zones(f, np.zeros((count, 3)), gradient, gradient.copy(), i, f.copy(), f.copy(), f.copy(), i.copy())


@numba.njit(inline="always")
def _harmonic(distance, rows, count):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(count):
        total += 1.0 / max(distance[rows[j]], NEAREST_WAY)
    return count / total


def zones_of(photons: PhotonMap, where: Points, own: NDArray[np.integer], recipe: Recipe) -> Zones:
    """Zones of places `where` (C,); own int64 (C,): row of the photon that a place is, or -1."""
    zones, p = Zones.empty(len(own)), photons.photons
    fill_zones(photons.tree, *photons.surface, p.distance, p.direction, p.flux, *where, own, recipe, zones)
    return zones


@numba.njit(nogil=True, cache=True)
def _zone(tree, share, distance, p, n, slab, recipe):  # type: ignore[no-untyped-def]
    """(rows, count, R, h, r, least cosine of normals) of steps 1 and 2."""
    cap, cosine, tilt = recipe.a * recipe.largest, FLAT_COS, recipe.a
    rows, distances2 = np.empty(recipe.knn, np.int64), np.empty(recipe.knn)
    count = nearest(tree, p, n, cap, FLAT_COS, slab * cap + SLAB_FLOOR, rows, distances2)
    h = _harmonic(distance, rows, count) if count else recipe.largest
    first = min(max(h, recipe.smallest), recipe.largest)
    r = recipe.a * first
    found, count = within(tree, p, n, r, FLAT_COS, slab * r + SLAB_FLOOR, np.empty(512, np.int64))
    while count < recipe.n_min and r < cap:
        r = min(GROWTH * r, cap)
        if share > 0.0:
            tilt = min(GROWTH * tilt, WIDEST)
            cosine = min(FLAT_COS, 1.0 - tilt * tilt)
        found, count = within(tree, p, n, r, cosine, slab * r + SLAB_FLOOR, found)
    if count:
        h = _harmonic(distance, found, count)
    radius = min(max(h, first / 2), 2 * first)
    return found, count, min(max(radius, recipe.smallest), recipe.largest), h, r, cosine


@numba.njit(nogil=True, cache=True)
def zone_area(tree, ground, share, p, n, tangents, slab, rows, count, r, cosine, estimator):  # type: ignore[no-untyped-def]
    """(area, hull vertices): area that the photons `rows` within r of p stand for."""
    if share > 0.0 and estimator == CORRECTED:
        area = measured_area(ground, share, p, n, r, cosine, slab * r + SLAB_FLOOR)
        if area > 0.0:
            return area, 0
    x, y = np.zeros(count), np.zeros(count)
    for j in range(count):
        for c in range(3):
            step = tree.positions[rows[j], c] - p[c]
            x[j] += step * tangents[0, c]
            y[j] += step * tangents[1, c]
    return area_and_vertices(x, y, count, r, estimator)


@numba.njit(parallel=True, cache=True)
def fill_zones(tree, ground, share, distance, came, flux, positions, normals, slabs, own, recipe, zones):  # type: ignore[no-untyped-def]
    """Fill `zones` for places positions, normals (C, 3), slabs (C,); own int64 (C,): row of the photon a place is, or -1."""
    for i in numba.prange(len(positions)):
        _fill_one(i, tree, ground, share, distance, came, flux, positions[i], normals[i], slabs[i], own[i], recipe, zones)


@numba.njit(nogil=True, cache=True)
def _fill_one(i, tree, ground, share, distance, came, flux, p, n, slab, own, recipe, zones):  # type: ignore[no-untyped-def]
    rows, count, radius, h, r, cosine = _zone(tree, share, distance, p, n, slab, recipe)
    tangents = tangents_of(n)
    area, vertices = zone_area(tree, ground, share, p, n, tangents, slab, rows, count, r, cosine, recipe.estimator)
    zones.radius[i], zones.photons[i], zones.reach[i], zones.cosine[i] = radius, count, r, cosine
    zones.area[i], zones.vertices[i] = area, vertices
    others = 0
    for j in range(count):
        if rows[j] == own:
            continue
        for c in range(3):
            zones.irradiance[i, c] += flux[rows[j], c] / area
        rows[others] = rows[j]
        others += 1
    if recipe.gradients == OFF or others < (recipe.n_grad if recipe.gradients == THRESHOLDED else 2):
        return
    _gradients(
        rows, others, came, flux, distance, tangents, n, h, radius, area, recipe,
        zones.irradiance[i], zones.translation[i], zones.rotation[i],
    )  # fmt: skip


@numba.njit(inline="always")
def tangents_of(n):  # type: ignore[no-untyped-def]
    """The tangents of `sampling.frame`, (2, 3)."""
    sign = 1.0 if n[2] >= 0 else -1.0
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    tangents = np.empty((2, 3))
    tangents[0, 0], tangents[0, 1], tangents[0, 2] = 1 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]
    tangents[1, 0], tangents[1, 1], tangents[1, 2] = b, sign + n[1] * n[1] * a, -n[1]
    return tangents


@numba.njit(nogil=True, cache=True)
def _gradients(rows, count, came, flux, distance, tangents, n, h, radius, area, recipe, irradiance, translation, rotation):  # type: ignore[no-untyped-def]
    """Fill one record's gradients (3 channels, 3 components) from its photons."""
    u, v, w, way, power = np.zeros(count), np.zeros(count), np.zeros(count), np.empty(count), np.empty((count, 3))
    for j in range(count):
        for c in range(3):
            u[j] += came[rows[j], c] * tangents[0, c]
            v[j] += came[rows[j], c] * tangents[1, c]
            w[j] += came[rows[j], c] * n[c]
            power[j, c] = flux[rows[j], c]
        way[j] = max(distance[rows[j]], NEAREST_WAY)
    shape = (recipe.rows, recipe.columns)
    radiance, inverse, hits = np.zeros((shape[0], shape[1], 3)), np.zeros(shape), np.zeros(shape, np.int64)
    cell_sums(u, v, w, power, way, count, recipe.rows, recipe.columns, radiance, inverse, hits)
    radiance *= recipe.rows * recipe.columns / (np.pi * area)
    for j in range(recipe.rows):
        for k in range(recipe.columns):
            inverse[j, k] = hits[j, k] / inverse[j, k] if hits[j, k] else h
    along, turn = np.empty((3, 2)), np.empty((3, 2))
    gradients_of(radiance, inverse, along, turn)
    if recipe.gradients == SHRUNK:
        noise = NOISE / np.sqrt(count) * (irradiance[0] + irradiance[1] + irradiance[2])
        shrink(along, noise / h)
        shrink(turn, noise)
    for channel in range(3):
        size = np.sqrt(along[channel, 0] ** 2 + along[channel, 1] ** 2)
        limit = min(1.0, irradiance[channel] / (radius * size)) if size > 0 else 0.0
        for c in range(3):
            translation[channel, c] = limit * (along[channel, 0] * tangents[0, c] + along[channel, 1] * tangents[1, c])
            rotation[channel, c] = turn[channel, 0] * tangents[0, c] + turn[channel, 1] * tangents[1, c]
