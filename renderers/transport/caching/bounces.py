"""All bounces: what rays of a record hit reflects not only direct light, but the irradiance of a coarse cache as well.

The coarse cache ("anchors") holds one irradiance for each cell of a voxel grid and each of six directions a surface can face,
where rays got to: those of some pixels first, then those of the anchors found so. An anchor's rays are cast once; which anchors
their hits belong to is kept, so that all bounces follow from iterating

    E_s = D_s + 1/MN Σ_jk ρ(x_jk) E_t(jk)        D: one bounce, as in any record; t(jk): the anchor of the hit's cell

until nothing changes. A hit then reflects its direct light plus ρ/π E_t. Steps between cells are averaged over the thousands of
rays of a record. Glossy surfaces count as diffuse ones of their mean albedo from the second bounce on.

The idea is Ward's of 1988, recursive ambient calculation, with a fixed grid in place of further levels of records.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import materials_at, mean_albedo
from renderers.transport.caching.hemisphere import PolarSampler, grid_of
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.records import Sites
from renderers.transport.seen import Seen
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
SIDE = 48  # cells along each axis of the World's cube
RAYS = 256
STARTS = 1024  # pixels whose rays find the first anchors
GENERATIONS = 8
SITES_PER_TASK = 64
CONVERGED, MOST_STEPS = 1e-4, 500


class Anchors(NamedTuple):
    """table int32 (6·SIDE³,): anchor of each cell and direction, -1 where there is none; irradiance float64 (A, 3)."""

    table: NDArray[np.int32]
    irradiance: F64

    def at(self, seen: Seen) -> F64:
        """Irradiance (S, 3) of hits, 0 where no anchor is."""
        found = self.table[cells_of(seen.position, seen.normal)]
        return np.asarray(np.where((found >= 0)[:, None], self.irradiance[np.maximum(found, 0)], 0.0))


class AllReflectedLight:
    """Incoming light of all bounces, as `Incoming`: another one's (direct light, reflected), and what the anchors add to it."""

    def __init__(self, world: World, direct: Incoming, anchors: Anchors) -> None:
        self._world, self._direct, self._anchors = world, direct, anchors

    def __call__(self, seen: Seen, random: F64) -> tuple[F32, int]:
        """See `Incoming`."""
        radiance, rays = self._direct(seen, random)
        return (radiance + albedo_of(self._world, seen) * self._anchors.at(seen) / np.pi).astype(np.float32), rays


class _Cast(NamedTuple):
    """Of N sites: direct irradiance (N, 3); of their hits: site int64 (H,), cell int64 (H,), albedo float32 (H, 3), and places for
    anchors; rays cast."""

    direct: F64
    site: NDArray[np.int64]
    cell: NDArray[np.int64]
    albedo: F32
    hits: Sites
    rays: int


def anchors_of(world: World, sites: Sites, direct: Incoming, seed: int = 0, counters: Counter[str] | None = None) -> Anchors:
    """Anchors on all surfaces that light of a view's points (N) can come from. counters: `anchors` and `rays` are added to."""
    table = np.full(6 * SIDE**3, -1, np.int32)
    sources, targets, shares, received = [], [], [], []
    rays, count = 0, 0
    start = sites.rows(slice(None, None, max(1, len(sites.position) // STARTS)))
    wanted = _new_cells(_cast(world, start, direct, 64, seed, 0), table)
    for _ in range(GENERATIONS):
        if not len(wanted.position):
            break
        table[cells_of(wanted.position, wanted.normal)] = np.arange(count, count + len(wanted.position))
        found = _cast(world, wanted, direct, RAYS, seed, len(start.position) + count)
        sources.append(found.site + count)
        targets.append(found.cell)
        shares.append(found.albedo / grid_of(RAYS).cells)
        received.append(found.direct)
        rays, count = rays + found.rays, count + len(wanted.position)
        wanted = _new_cells(found, table)
    if counters is not None:
        counters["rays"] += rays
        counters["anchors"] += count
    if not count:
        return Anchors(table, np.zeros((1, 3)))
    pairs = np.concatenate(sources), table[np.concatenate(targets)]
    return Anchors(table, _all_bounces(np.concatenate(received), *pairs, np.concatenate(shares)))


def _cast(world: World, sites: Sites, direct: Incoming, rays: int, seed: int, first: int) -> _Cast:
    grid = grid_of(rays)

    def task(part: slice) -> _Cast:
        caught: list[Seen] = []

        def watched(seen: Seen, random: F64) -> tuple[F32, int]:
            caught.append(seen)
            return direct(seen, random)

        here = sites.rows(part)
        cast, spent = PolarSampler(world, grid, watched, seed).hemispheres(here, first + part.start)
        seen = caught[0]
        light = np.pi * cast.radiance.mean(axis=(1, 2), dtype=np.float64)
        hits = Sites(seen.position, seen.normal, seen.geometric)
        cell = cells_of(seen.position, seen.normal)
        return _Cast(light, seen.ray // grid.cells + part.start, cell, albedo_of(world, seen).astype(np.float32), hits, spent)

    done = in_threads(task, chunks(len(sites.position), SITES_PER_TASK))
    return _Cast(
        direct=np.concatenate([one.direct for one in done]),
        site=np.concatenate([one.site for one in done]),
        cell=np.concatenate([one.cell for one in done]),
        albedo=np.concatenate([one.albedo for one in done]),
        hits=Sites(*(np.concatenate(column) for column in zip(*(one.hits for one in done), strict=True))),
        rays=sum(one.rays for one in done),
    )


def _new_cells(found: _Cast, table: NDArray[np.int32]) -> Sites:
    """The first hit of each cell that has no anchor yet."""
    cells, places = np.unique(found.cell, return_index=True)
    return found.hits.rows(places[table[cells] < 0])


def cells_of(position: F64, normal: F64) -> NDArray[np.int64]:
    """Number of the cell and direction (N,) of points on surfaces whose normals (N, 3) face where they are seen from."""
    place = np.clip((position + 1) * (SIDE / 2), 0, SIDE - 1).astype(np.int64)
    axis = np.abs(normal).argmax(axis=1)
    facing = 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0)
    return np.asarray(((place[:, 0] * SIDE + place[:, 1]) * SIDE + place[:, 2]) * 6 + facing)


def albedo_of(world: World, seen: Seen) -> F64:
    """Diffuse reflectance (S, 3) of hits, of glossy surfaces their mean albedo."""
    shiny = np.flatnonzero(world.materials.kind[seen.material] != LAMBERT)
    if not len(shiny):
        return seen.base
    albedo = seen.base.copy()
    albedo[shiny] = mean_albedo(materials_at(world.materials, seen.material[shiny], seen.base[shiny]))
    return albedo


def _all_bounces(received: F64, site: NDArray[np.int64], target: NDArray[np.int32], share: F32) -> F64:
    """Fixed point of E = D + Σ share E[target], by iteration: each step adds a bounce."""
    irradiance = received.copy()
    for _ in range(MOST_STEPS):
        before = irradiance
        irradiance = received.copy()
        _add_bounce(before, site, target, share, irradiance)
        if np.abs(irradiance - before).max() <= CONVERGED * max(irradiance.max(), 1e-30):
            break
    return irradiance


@numba.njit(nogil=True, cache=True)
def _add_bounce(before, site, target, share, out):  # type: ignore[no-untyped-def]
    for h in range(len(site)):
        if target[h] >= 0:
            for c in range(3):
                out[site[h], c] += share[h, c] * before[target[h], c]
