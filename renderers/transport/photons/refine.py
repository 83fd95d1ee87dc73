"""Progressive refinement: more photons improve the records that exist, with a radius that shrinks slowly enough to converge.

Knaus & Zwicker (2011): independent rounds of photons, each estimated within

    r_{i+1}² = r_i² (i + α)/(i + 1),        0 < α < 1,

and averaged. The variance of the mean falls as i^-α and its bias (r² ΔE/8) as i^-(1-α): both vanish, with memory for one round.
Rounds are joined as Σ flux / Σ area, which keeps the mean of 1/A out of it. A zone that has become too small for its hull to say
much keeps the share of the disc that its surface filled when last seen by ENOUGH photons. The tilt √(1 - n·n_i) that a zone takes
in shrinks with r down to that of FLAT_COS. Places, R and gradients of the records stay, and the light of radiance
records: what remains is the error of interpolation.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numba
import numpy as np

from renderers.scene.world import World
from renderers.transport.photons.density import FLAT_COS, SLAB_FLOOR, points
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.tracing import trace
from renderers.transport.photons.tree import within
from renderers.transport.photons.walk import Cache
from renderers.transport.photons.zones import tangents_of, zone_area

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
    flux, share, first = records.irradiance * area[:, None], area / (np.pi * radius2), radius2
    for k in range(1, rounds):
        radius2 = radius2 * (k + ALPHA) / (k + 1)
        cosine = np.minimum(FLAT_COS, 1 - (1 - cache.zones.cosine) * radius2 / first)
        more = photon_map(trace(world, photons.emitted, seed, first=k * photons.emitted, counters=counters))
        _add_round(
            more.tree, *photons.surface, more.photons.flux, *where, np.sqrt(radius2), cosine, estimator, share, flux, area
        )  # fmt: skip
    return cache._replace(records=replace(records, irradiance=flux / area[:, None]))


@numba.njit(parallel=True, cache=True)
def _add_round(tree, ground, measure, power, positions, normals, slabs, radii, cosines, estimator, share, flux, area):  # type: ignore[no-untyped-def]
    """Add one round to flux (C, 3) and area (C,); share (C,): of the disc that a place's surface fills, kept up to date."""
    for i in numba.prange(len(positions)):
        p, n, r = positions[i], normals[i], radii[i]
        rows, count = within(tree, p, n, r, cosines[i], slabs[i] * r + SLAB_FLOOR, np.empty(256, np.int64))
        if count >= ENOUGH:
            found, _ = zone_area(tree, ground, measure, p, n, tangents_of(n), slabs[i], rows, count, r, cosines[i], estimator)
            share[i] = found / (np.pi * r * r)
        area[i] += share[i] * np.pi * r * r
        for j in rows[:count]:
            for c in range(3):
                flux[i, c] += power[j, c]
