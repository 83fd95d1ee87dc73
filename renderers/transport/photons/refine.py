"""Progressive refinement: more photons improve the records that exist, with a radius that shrinks slowly enough to converge.

Knaus & Zwicker (2011): independent rounds of photons, each estimated within

    r_{i+1}² = r_i² (i + α)/(i + 1),        0 < α < 1,

and averaged. The variance of the mean falls as i^-α and its bias (r² ΔE/8) as i^-(1-α): both vanish, with memory for one round.
Places, R and gradients of the records stay: what remains is the error of interpolation.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numba
import numpy as np

from renderers.scene.world import World
from renderers.transport.photons.density import FLAT_COS, SLAB_FLOOR, points, projected_area
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.tracing import trace
from renderers.transport.photons.tree import within
from renderers.transport.photons.walk import Cache

ALPHA = 0.7


def refined(
    world: World, photons: PhotonMap, cache: Cache, estimator: int, seed: int, rounds: int, counters: Counter[str] | None = None
) -> Cache:
    """The cache after `rounds` rounds of as many photons as the map emitted; round 1 made the cache. Raises ValueError below 1.

    Round k traces the photons of indices (k-1)·N_e … k·N_e-1 of the seed.
    """
    if rounds < 1:
        raise ValueError(f"rounds must be 1 or more, got {rounds}")
    records, p = cache.records, photons.photons
    where = points(world, records.position, records.normal, p.triangle[cache.photon])
    total, radius2 = records.irradiance.copy(), cache.zones.reach**2
    for k in range(1, rounds):
        radius2 = radius2 * (k + ALPHA) / (k + 1)
        more = photon_map(trace(world, photons.emitted, seed, first=k * photons.emitted, counters=counters))
        found = np.zeros_like(total)
        _fill_fixed(more.tree, more.photons.flux, *where, np.sqrt(radius2), estimator, found)
        total += found
    return cache._replace(records=replace(records, irradiance=total / rounds))


@numba.njit(parallel=True, cache=True)
def _fill_fixed(tree, flux, positions, normals, slabs, radii, estimator, out):  # type: ignore[no-untyped-def]
    """Irradiance within one radius per place, into out (C, 3)."""
    for i in numba.prange(len(positions)):
        p, n, r = positions[i], normals[i], radii[i]
        rows, count = within(tree, p, n, r, FLAT_COS, slabs[i] * r + SLAB_FLOOR, np.empty(256, np.int64))
        if count:
            area = projected_area(tree, p, n, rows, count, r, estimator)
            for j in rows[:count]:
                for c in range(3):
                    out[i, c] += flux[j, c] / area
