"""Progressive refinement: more photons improve the records that exist, with a radius that shrinks slowly enough to converge.

Knaus & Zwicker (2011): independent rounds of photons, each estimated within

    r_{i+1}² = r_i² (i + α)/(i + 1),        0 < α < 1,

and averaged. The variance of the mean falls as i^-α and its bias (r² ΔE/8) as i^-(1-α): both vanish, with memory for one round.
Rounds are joined as Σ flux / Σ area, which keeps the mean of 1/A out of it. A zone that has become too small for its hull to say
much keeps the share of the disc that its surface filled when last seen by ENOUGH photons. Places, R and gradients of the records
stay: what remains is the error of interpolation.
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
ENOUGH = 20


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
    radius2, area = cache.zones.reach**2, cache.zones.area.copy()
    flux, share = records.irradiance * area[:, None], area / (np.pi * radius2)
    for k in range(1, rounds):
        radius2 = radius2 * (k + ALPHA) / (k + 1)
        more = photon_map(trace(world, photons.emitted, seed, first=k * photons.emitted, counters=counters))
        _add_round(more.tree, more.photons.flux, *where, np.sqrt(radius2), estimator, share, flux, area)
    return cache._replace(records=replace(records, irradiance=flux / area[:, None]))


@numba.njit(parallel=True, cache=True)
def _add_round(tree, power, positions, normals, slabs, radii, estimator, share, flux, area):  # type: ignore[no-untyped-def]
    """Add one round to flux (C, 3) and area (C,); share (C,): of the disc that a place's surface fills, kept up to date."""
    for i in numba.prange(len(positions)):
        p, n, r = positions[i], normals[i], radii[i]
        rows, count = within(tree, p, n, r, FLAT_COS, slabs[i] * r + SLAB_FLOOR, np.empty(256, np.int64))
        if count >= ENOUGH:
            share[i] = projected_area(tree, p, n, rows, count, r, estimator) / (np.pi * r * r)
        area[i] += share[i] * np.pi * r * r
        for j in rows[:count]:
            for c in range(3):
                flux[i, c] += power[j, c]
