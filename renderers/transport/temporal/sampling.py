"""Polar hemispheres whose hits are kept, so that the same hemisphere can be foreseen one frame ahead.

A place has a number for all its life, and its hemisphere the jitter and the light samples of that number in every frame: in a scene
at rest a renewed record has the bytes of the one before, and in a moving one the noise of successive records cancels in their
differences.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.gradients import polar_moments
from renderers.transport.caching.hemisphere import GOLDEN, RAYS_PER_TASK, Grid, PolarSampler, grid_of, numbers_of, records_of
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.radiance import radiance_moments, radiance_records
from renderers.transport.caching.records import Records, Sites
from renderers.transport.raycast import OFFSET, Hits
from renderers.transport.sampling import frame
from renderers.transport.seen import Seen, seen_along
from renderers.transport.temporal.trends import Trends
from renderers.transport.temporal.updating import Found
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
LOST = 1 / 3


class Cast(NamedTuple):
    """Hemispheres of K places with all that was found on the way. Rays are numbered record by record, cell by cell.

    origins, directions float32 (K·cells, 3); found: by the rays; random float64 (K, 8): numbers of the places; tangents float64
    (K, 2, 3); cell int64 (K·cells,): number of each ray among those of the whole hemispheres of the K places; seen: of the rays
    that hit something, None where not all of them were shaded.
    """

    sites: Sites
    tangents: F64
    origins: F32
    directions: F32
    found: Found
    random: F64
    cell: I64
    seen: Seen | None

    def part(self, places: I64, cells: I64) -> Cast:
        """Some cells (C,) of the hemispheres of some places (M,), in order."""
        rays = (places[:, None] * (len(self.origins) // len(self.tangents)) + cells).ravel()
        hits: Any = (column[rays] for column in self.found.hits)
        found = Found(Hits(*hits), self.found.radiance[rays], self.found.nearness[rays])
        # light samples are numbered by place and cell
        cell = np.arange(len(places))[:, None] * (len(self.origins) // len(self.tangents)) + cells
        return Cast(
            self.sites.rows(places), self.tangents[places], self.origins[rays], self.directions[rays], found, self.random[places],
            cell.ravel(), None,
        )  # fmt: skip


class Ahead(Protocol):
    """Foresees hemispheres one frame later. smooth: what changes does so by a little everywhere, as where lights move."""

    @property
    def smooth(self) -> bool: ...

    def __call__(self, cast: Cast) -> tuple[Found, int]:
        """What the rays find one frame later, and the number of rays cast. Called from several threads."""

    def changes(self, sites: Sites) -> NDArray[np.bool_]:
        """Places (K,) whose hemispheres change as a whole: foreseeing all of their rays would cost as much as a record."""


class TemporalSampler(PolarSampler):
    """Computes records at places with numbers of their own, and the same records one frame ahead. Counters as `PolarSampler`.

    order: None for irradiance records, 2 at least for radiance records.
    """

    def __init__(
        self, world: World, grid: Grid, incoming: Incoming, seed: int, counters: Counter[str], sparse: int = 1,
        order: int | None = None,
    ) -> None:  # fmt: skip
        super().__init__(world, grid, incoming, seed, counters=counters)
        self.order, self.equal_solid_angle = order, order is not None
        self._coarse = (
            coarse(grid, self._fewer(max(4, grid.cells // sparse))) if sparse > 1 else Coarse(grid, np.arange(grid.cells))
        )

    def sample(self, sites: Sites, places: I64, ahead: Ahead | None = None, tangents: F64 | None = None) -> tuple[Records, Records]:
        """Records at N places numbered `places` (N,), and what they will be one frame later; without `ahead`, what they are now.

        tangents (N, 2, 3): axes of the hemispheres, where they aren't those of `sampling.frame`.
        """
        size, order = max(1, RAYS_PER_TASK // self.grid.cells), np.arange(len(places))
        parts = chunks(len(order), size)
        if ahead is not None:
            # places that are foreseen alike go together
            changes = ahead.changes(sites)
            order, alike = np.argsort(changes, kind="stable"), int(np.count_nonzero(~changes))
            parts = [
                *chunks(alike, size),
                *(slice(alike + part.start, alike + part.stop) for part in chunks(len(order) - alike, size)),
            ]

        def task(part: slice) -> tuple[Records, Records, int]:
            rows = order[part]
            cast, rays = self.cast(sites.rows(rows), places[rows], None if tangents is None else tangents[rows])
            now = self._records(cast, cast.found)
            if ahead is None:
                return now, now, rays
            later, more = self.foreseen(cast, now, ahead)
            return now, later, rays + more

        done = in_threads(task, parts)
        self.counters["rays"] += sum(rays for _, _, rays in done)
        self.counters["records"] += len(places)
        self.counters["predictions"] += 0 if ahead is None else len(places)
        back = np.argsort(order)
        return Records.joined([now for now, _, _ in done]).rows(back), Records.joined([later for _, later, _ in done]).rows(back)

    def cast(self, sites: Sites, places: I64, tangents: F64 | None = None) -> tuple[Cast, int]:
        """The hemispheres of a few places, and the number of rays cast. In the calling thread up to RAYS_PER_TASK rays."""
        cells = len(places) * self.grid.cells
        tangents = np.stack(frame(sites.normal), axis=1) if tangents is None else tangents
        random = np.stack([numbers_of(self._seed, int(place)) for place in places])
        origins, directions = self._rays(sites, tangents, random)
        hits = self._caster.first_hit(origins, directions, self.grid)
        seen = seen_along(self.world, directions, hits)
        found = Found(hits, np.zeros((cells, 3), np.float32), np.zeros(cells, np.float32))
        found.radiance[seen.ray], shadow_rays = self._incoming(seen, self._light_numbers(seen, random))
        found.nearness[seen.ray] = 1 / np.maximum(hits.t[seen.ray], OFFSET)
        return Cast(sites, tangents, origins, directions, found, random, np.arange(cells), seen), cells + shadow_rays

    def foreseen(self, cast: Cast, now: Records, ahead: Ahead) -> tuple[Records, int]:
        """Records `now` of a cast one frame later, and the number of rays cast.

        Where a hemisphere changes as a whole, a coarse part of it is foreseen, and its change is that of the record.
        """
        changes = ahead.changes(cast.sites)
        if len(self._coarse.cells) == self.grid.cells or not changes.any():
            found, rays = ahead(cast)
            return self._records(cast, found), rays
        trends, order, total = list[Trends](), list[I64](), 0
        for index, grid, cells in (
            (np.flatnonzero(~changes), self.grid, np.arange(self.grid.cells)),
            (np.flatnonzero(changes), *self._coarse),
        ):
            if len(index):
                part = cast.part(index, cells)
                found, rays = ahead(part)
                last, first = (self._records(part, light, grid) for light in (found, part.found))
                differences = (found.radiance - part.found.radiance).reshape(len(index), *grid, 3)
                share = 0.0 if ahead.smooth else self._unevenness(grid) - self._unevenness(self.grid)
                trends.append(_certain(Trends.between(first, last, np.ones(len(index))), differences, share))
                order.append(index)
                total += rays
        return Trends.joined(trends).rows(np.argsort(np.concatenate(order))).after(now, np.ones(len(changes))), total

    def light_numbers(self, seen: Seen, cast: Cast) -> F64:
        """Random numbers float64 (S, 6) for the lights of hits of a cast's rays."""
        return self._light_numbers(seen._replace(ray=cast.cell[seen.ray]), cast.random)

    @staticmethod
    def _fewer(cells: int) -> Grid:
        """A grid of the same kind with so many cells."""
        return grid_of(cells)

    @staticmethod
    def _unevenness(grid: Grid) -> float:
        """Sum of the squares of the shares that cells have in irradiance: variance of the mean of cells of variance 1."""
        return 1 / grid.cells

    def _records(self, cast: Cast, found: Found, grid: Grid | None = None) -> Records:
        shape = len(cast.tangents), *(self.grid if grid is None else grid)
        light, near = found.radiance.reshape(*shape, 3), found.nearness.reshape(shape)
        if self.order is None:
            return records_of(cast.sites, cast.tangents, polar_moments(light, near))
        return radiance_records(cast.sites, cast.tangents, radiance_moments(light, near, self.order))


class Coarse(NamedTuple):
    """A coarse grid, and the cells (C,) of a fine one that stand for its own."""

    grid: Grid
    cells: I64


def coarse(grid: Grid, few: Grid) -> Coarse:
    """One cell of a grid in each cell of a coarser one, where its own golden-ratio sequences would meet it.

    As in whole hemispheres an edge along a ring or a sector is then met at evenly spread places (`hemisphere`).
    """
    row, column = np.divmod(np.arange(few.cells), few.sectors)
    ring = ((row + column * GOLDEN % 1) * grid.rings / few.rings).astype(np.int64)
    sector = ((column + row * GOLDEN % 1) * grid.sectors / few.sectors).astype(np.int64)
    return Coarse(few, ring * grid.sectors + sector)


def _certain(change: Trends, differences: F32, share: float) -> Trends:
    """Changes of K records, found from C = M·N cells that changed by `differences` (K, M, N, 3), less what is noise of them.

    The square of a mean over C of all cells exceeds that over all by its noise, variance · (1/C - 1/all) on average (`share`: the
    bracket): taken as it is, it would make lives shorter than all rays would. Cells are strata, whose variance is half the mean
    square of what neighbours differ by: a smooth change has none. Irradiance is π times a mean; the n² coefficients are 2π times
    means of L·H_i, and the mean squares of the H_i are 1/2π. A change that drowns in its noise isn't known to be none: if it
    exceeds LOST of its noise, it isn't scaled below that.
    """
    apart = np.diff(differences, axis=2, append=differences[:, :, :1]).astype(np.float64)
    variance = share * (apart**2).mean(axis=(1, 2)) / 2
    if change.coefficients is None:
        noise, square = np.pi**2 * variance, change.irradiance**2
    else:
        noise, square = 2 * np.pi * change.coefficients.shape[1] * variance, (change.coefficients**2).sum(axis=1)
    part = noise / np.maximum(square, 1e-300)
    return change.scaled(np.sqrt(np.maximum(1 - part, np.minimum(1, LOST**2 * part))))
