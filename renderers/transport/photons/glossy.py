"""Radiance records made of photons: light that glossy surfaces reflect, and lobes too sharp for records.

A photon of flux Φ that came along ω stands for the radiance Φ/(A n·ω) in one direction. A zone's photons landed all over it, but
each knows where it came from, x = p_j + d_j ω_j: seen from the zone's place p that is the direction ω'_j of x - p, without the
parallax that would blur a reflection by the angle a. So, in the frame of the place,

    λ_i(p) = 1/A Σ_j Φ_j H_i(ω'_j) / max(n·ω'_j, LEAST_COSINE)

and with f_r cos θ of the viewer in the same basis reflected radiance (`caching.glossy`). The clamp touches the share LEAST_COSINE²
of uniform light. The records have no gradients: derivatives of these sums, extrapolated, made images no better, so they lie closer.

Sharper lobes are traced (`caching.traced`): what their rays hit reflects its direct light, and the irradiance of the record nearest
to the hit.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import LAMBERT, World
from renderers.transport.caching.bounces import albedo_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Records
from renderers.transport.hemispherical.basis import hemispherical_harmonics
from renderers.transport.photons.density import FLAT_COS, SLAB_FLOOR, Points, points
from renderers.transport.photons.map import PhotonMap
from renderers.transport.photons.tree import Tree, build, nearest, within
from renderers.transport.photons.walk import walk
from renderers.transport.photons.zones import Recipe, Zones
from renderers.transport.sampling import frame
from renderers.transport.seen import Seen
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
LEAST_COSINE = 0.05
REACH = 0.3  # of the nearest record to a hit, World units
PLACES_PER_TASK = 16


def radiance_of_zones(photons: PhotonMap, where: Points, own: NDArray[np.integer], zones: Zones, order: int) -> F64:
    """Coefficients float64 (C, order², 3) of the light that `zones` of places (C,) receive; own: see `zones.zones_of`."""
    axes = np.stack([*frame(where.normal), where.normal], axis=1)
    out = np.zeros((len(own), order**2, 3))

    def task(part: slice) -> None:
        for k in range(part.start, part.stop):
            rows = _rows(photons, where, zones, own, k)
            p = photons.photons.rows(rows)
            usual = p.direction.astype(np.float64) @ axes[k].T
            aim = _aimed((p.position - where.position[k]) @ axes[k].T + p.distance[:, None] * usual, usual)
            weight = p.flux / (zones.area[k] * np.maximum(aim[:, 2:], LEAST_COSINE))
            out[k] = hemispherical_harmonics(aim, order).T @ weight

    in_threads(task, chunks(len(own), PLACES_PER_TASK))
    return out


def _rows(photons: PhotonMap, where: Points, zones: Zones, own: NDArray[np.integer], k: int) -> NDArray[np.int64]:
    """Photons of zone k without its own."""
    reach = zones.reach[k]
    height, scratch = where.slab[k] * reach + SLAB_FLOOR, np.empty(512, np.int64)
    found, count = within(photons.tree, where.position[k], where.normal[k], reach, zones.cosine[k], height, scratch)
    return np.asarray(found[:count][found[:count] != own[k]])


def _aimed(source: F64, usual: F64) -> F64:
    """Unit directions (N, 3) to sources, local; `usual` where those lie on the horizon or below."""
    length = np.linalg.norm(source, axis=1, keepdims=True)
    fine = source[:, 2:] > 1e-3 * length
    aim = np.where(fine, source / np.where(fine, length, 1), usual)
    aim[:, 2] = np.maximum(aim[:, 2], 0)  # a photon on a bent normal may have come from under the tangent plane
    return np.asarray(aim)


def radiance_records(
    world: World, photons: PhotonMap, recipe: Recipe, a: float, order: int, counters: Counter[str] | None = None
) -> Records:
    """Records with coefficients for the photons on glossy surfaces, found by a walk at accuracy a; zones are those of the recipe.

    counters: `radiance_records` is added to.
    """
    glossy = world.materials.kind[world.material[photons.photons.triangle]] != LAMBERT
    records, zones, own = walk(world, photons, recipe, a=a, among=glossy)
    where = points(world, records.position, records.normal, photons.photons.triangle[own])
    light = radiance_of_zones(photons, where, own, zones, order)
    if counters is not None:
        counters["radiance_records"] += len(records)
    return replace(records, coefficients=light, coefficient_gradients=np.zeros((len(own), 2, order**2, 3)))


class ReflectedPhotonLight:
    """Incoming light of all bounces along traced lobes, as `caching.incoming.Incoming`, from records of irradiance."""

    def __init__(self, world: World, records: Records) -> None:
        self._world, self._direct = world, ReflectedDirectLight(world)
        position, normal = records.position.astype(np.float32), records.normal.astype(np.float32)
        axis, split, levels, order = build(position)
        self._tree, self._value = Tree(axis, split, levels, position[order], normal[order]), records.irradiance[order]

    def __call__(self, seen: Seen, random: F64) -> tuple[F32, int]:
        """See `Incoming`."""
        radiance, rays = self._direct(seen, random)
        found = np.zeros((len(seen.position), 3))
        value_of_nearest(self._tree, self._value, seen.position, seen.normal, found)
        return (radiance + albedo_of(self._world, seen) / np.pi * found).astype(np.float32), rays


@numba.njit(nogil=True, cache=True)
def value_of_nearest(tree, value, positions, normals, out):  # type: ignore[no-untyped-def]
    """out (N, 3): value of the nearest record that faces the same way, 0 where none is within REACH."""
    rows, distances2 = np.empty(1, np.int64), np.empty(1)
    for i in range(len(positions)):
        if nearest(tree, positions[i], normals[i], REACH, FLAT_COS, REACH, rows, distances2):
            for c in range(3):
                out[i, c] = value[rows[0], c]
