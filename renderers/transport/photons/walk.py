"""Where records are put: one walk over the photons in the order they were traced; a photon that no record covers gets one.

    covered  ⟺  some record k has |p - p_k|/R_k + √(1 - n·n_k) ≤ a                   Gautron 2006, equation 6.1 (repaired: 1/a)

A record depends on the photons alone, not on other records: so the next `BATCH` uncovered photons are worked out at once, in
parallel, and then entered one by one, passing over those that a record entered before covers by now. The records are those of the
sequential walk, bit by bit, at any thread count; every photon is covered when the walk ends.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.records import Records
from renderers.transport.photons.density import points
from renderers.transport.photons.map import PhotonMap
from renderers.transport.photons.tree import within
from renderers.transport.photons.zones import Recipe, Zones, zones_of

BATCH = 64
FEWEST_IN_ZONE = 8


class Cache(NamedTuple):
    """Records with what they were made from; photon int64 (K,): row of the photon that each sits on."""

    records: Records
    zones: Zones
    photon: NDArray[np.int64]


def walk(
    world: World,
    photons: PhotonMap,
    recipe: Recipe,
    batch: int = BATCH,
    counters: Counter[str] | None = None,
    a: float | None = None,
    among: NDArray[np.bool_] | None = None,
) -> Cache:
    """Records for all photons of a map, or for those `among` (N,) them. counters: `records`, and `zones` worked out (those passed
    over included). a: accuracy at which records cover photons, the recipe's unless said otherwise."""
    p, tree = photons.photons, photons.tree
    covered = np.zeros(len(photons), bool) if among is None else ~among
    accuracy = recipe.a if a is None else a
    visiting = np.argsort(photons.order)
    kept: list[tuple[Zones, NDArray[np.int64]]] = []
    start, worked = 0, 0
    while True:
        chosen, start = next_uncovered(visiting, covered, start, batch)
        if not len(chosen):
            break
        worked += len(chosen)
        zones = zones_at(world, photons, recipe, chosen)
        entered = enter(tree, p.position[chosen], p.normal[chosen], zones.radius, chosen, accuracy, covered)
        kept.append((Zones(*(column[entered] for column in zones)), chosen[entered]))
    empty = Zones.empty(0)
    zones = Zones(*(np.concatenate(columns) for columns in zip(*(z for z, _ in kept), strict=True))) if kept else empty
    rows = np.concatenate([rows for _, rows in kept]) if kept else np.zeros(0, np.int64)
    if counters is not None:
        counters["records"] += len(rows)
        counters["zones"] += worked
    return Cache(records_of(zones, p.position[rows], p.normal[rows]), zones, rows)


def zones_at(world: World, photons: PhotonMap, recipe: Recipe, rows: NDArray[np.int64]) -> Zones:
    """Zones of places that are photons of the map, rows (C,)."""
    p = photons.photons
    return zones_of(photons, points(world, p.position[rows], p.normal[rows], p.triangle[rows]), rows, recipe)


def records_of(zones: Zones, position: NDArray[np.float32], normal: NDArray[np.float32]) -> Records:
    """Zones as records of an irradiance cache."""
    return Records(
        position.astype(np.float64), normal.astype(np.float64), zones.radius, zones.irradiance, zones.translation, zones.rotation
    )


def smallest_radius(world: World, photons: PhotonMap, a: float) -> float:
    """R_min at which a zone holds FEWEST_IN_ZONE photons in the mean: a R_min = √(8 A / (π n)), A the area of all surfaces."""
    return float(np.sqrt(FEWEST_IN_ZONE * world.areas.sum() / (np.pi * max(len(photons), 1))) / a)


@numba.njit(nogil=True, cache=True)
def next_uncovered(visiting, covered, start, most):  # type: ignore[no-untyped-def]
    """(the next `most` uncovered rows in visiting order, where to go on)."""
    chosen, count, i = np.empty(most, np.int64), 0, start
    first = len(visiting)
    while i < len(visiting) and count < most:
        if not covered[visiting[i]]:
            chosen[count] = visiting[i]
            first = min(first, i)
            count += 1
        i += 1
    return chosen[:count], first


@numba.njit(nogil=True, cache=True)
def enter(tree, position, normal, radius, rows, a, covered):  # type: ignore[no-untyped-def]
    """Enter records in order unless covered by then; marks the photons they cover; returns which were entered, bool (C,)."""
    entered = np.zeros(len(rows), np.bool_)
    found = np.empty(1024, np.int64)
    for i in range(len(rows)):
        if covered[rows[i]]:
            continue
        entered[i] = True
        found, count = within(tree, position[i], normal[i], a * radius[i], -2.0, 0.0, found)
        for j in found[:count]:
            if covered[j]:
                continue
            distance2 = bend2 = 0.0
            for c in range(3):
                distance2 += (tree.positions[j, c] - position[i, c]) ** 2
                bend2 += (tree.normals[j, c] - normal[i, c]) ** 2
            covered[j] = np.sqrt(distance2) / radius[i] + np.sqrt(bend2 / 2) <= a
        covered[rows[i]] = True
    return entered
