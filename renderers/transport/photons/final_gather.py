"""Final gathering: the indirect light of a pixel from rays that look the photon map up where they end (Jensen 1996).

    L = 1/M Σ_m  f_r(ω_m, v) (n·ω_m) / p(ω_m) · ρ(y_m)/π E(y_m)         ω_m by BRDF sampling, y_m the first hit along it

E at y_m is that of the nearest of the photons at which irradiance was computed beforehand (Christensen 1999), one in SPARSE, from
the others.
The surfaces that rays end on reflect as diffuse ones of their mean albedo.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.brdf import evaluate, materials_at, mean_albedo
from renderers.transport.lobes import sample_brdf, sampling_pdf
from renderers.transport.photons.density import CURVED_SLAB, FLAT_COS, SLAB_FLOOR, Lookup, irradiance, points
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.pixels import Pixels
from renderers.transport.photons.tracing import Traced
from renderers.transport.photons.tree import Tree, build, nearest
from renderers.transport.raycast import caster_of, off_surface
from renderers.transport.sampling import generator, lattice
from renderers.transport.surface import surface_at, turned

F64 = NDArray[np.float64]
SPARSE = 4


class StoredIrradiance(NamedTuple):
    """Irradiance at some photons: tree over them, value float64 (S, 3), reach: farthest look-up, World units."""

    tree: Tree
    value: F64
    reach: float


def stored_irradiance(world: World, photons: PhotonMap, how: Lookup) -> StoredIrradiance:
    """Irradiance at every SPARSE-th photon (tree order, hence spread evenly), estimated from the others.

    From the others, because places in a thin patch are the nearest to more of the surface: were their estimates low for
    lying in it, the mean over the surface would be low by about 1/k.
    """
    place = np.arange(len(photons)) % SPARSE == 0
    some, rest = photons.photons.rows(place), photons.photons.rows(~place).scaled(SPARSE / (SPARSE - 1))
    others = photon_map(Traced(rest, photons.emitted, photons.flux, 0, False))
    value = irradiance(others, points(world, some.position, some.normal, some.triangle), how)
    axis, split, levels, order = build(some.position)
    tree = Tree(axis, split, levels, some.position[order], some.normal[order])
    return StoredIrradiance(tree, value[order], how.radius)


def final_gather(
    world: World, pixels: Pixels, stored: StoredIrradiance, rays: int, seed: int, counters: Counter[str] | None = None
) -> F64:
    """Indirect radiance towards the viewer, float64 (P, 3). Each pixel moves one lattice by a random shift: `rays` directions."""
    shift = generator(seed, "final gather").random((len(pixels.row), 3))
    caster, total, cast = caster_of(world), np.zeros((len(pixels.row), 3)), 0
    for point in lattice(rays, 3):
        direction = sample_brdf(pixels.materials, pixels.normal, pixels.view, (point + shift) % 1.0)
        density = sampling_pdf(pixels.materials, pixels.normal, pixels.view, direction)
        cosine = np.einsum("ij,ij->i", pixels.normal, direction)
        up = np.flatnonzero((cosine > 0) & (density > 0))
        hits = caster.first_hit(off_surface(pixels.position[up], pixels.geometric[up], direction[up]), direction[up])
        cast += len(up)
        hit = np.flatnonzero(hits.triangle >= 0)
        rows = up[hit]
        arriving = _leaving(world, stored, hits.triangle[hit], hits.u[hit], hits.v[hit], -direction[rows])
        f = evaluate(pixels.materials.rows(rows), pixels.normal[rows], direction[rows], pixels.view[rows])
        total[rows] += f * arriving * (cosine[rows] / density[rows])[:, None]
    if counters is not None:
        counters["rays"] += cast
    return total / rays


def _leaving(
    world: World, stored: StoredIrradiance, triangle: NDArray[np.int32], u: NDArray[np.float32], v: NDArray[np.float32], back: F64
) -> F64:
    """Reflected radiance of hit points towards `back` (N, 3)."""
    surface = surface_at(world, triangle, u, v)
    found = np.zeros((len(triangle), 3))
    _nearest_value(stored.tree, stored.value, surface.position, turned(surface.normal, back), stored.reach, found)
    albedo = mean_albedo(materials_at(world.materials, surface.material, surface.base))
    return np.asarray(albedo / np.pi * found)


@numba.njit(parallel=True, cache=True)
def _nearest_value(tree, value, positions, normals, reach, out):  # type: ignore[no-untyped-def]
    height = CURVED_SLAB * reach + SLAB_FLOOR
    for i in numba.prange(len(positions)):
        rows, distances2 = np.empty(1, np.int64), np.empty(1)
        if nearest(tree, positions[i], normals[i], reach, FLAT_COS, height, rows, distances2):
            for c in range(3):
                out[i, c] = value[rows[0], c]
