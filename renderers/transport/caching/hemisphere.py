"""Polar hemispheres over many records at once, and the records made of them.

Rays leave in batches of RAYS_PER_TASK: generated, cast, shaded and summed up by one thread, whose arrays stay small. A record
depends on its place, its number and the seed alone, hence neither on its batch nor on the number of threads.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.gradients import Moments, polar_moments
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.records import Records, Sites
from renderers.transport.raycast import OFFSET, caster_of
from renderers.transport.sampling import frame, generator, lattice
from renderers.transport.seen import Seen, seen_along
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
RAYS_PER_TASK = 1 << 16
GOLDEN = (np.sqrt(5) - 1) / 2


class Grid(NamedTuple):
    """Cells of a polar hemisphere: rings M (over the polar angle) and sectors N (azimuth)."""

    rings: int
    sectors: int

    @property
    def cells(self) -> int:
        """Rays a hemisphere."""
        return self.rings * self.sectors


def grid_of(rays: int) -> Grid:
    """The grid of nearly square cells (N ≈ π M) nearest to a number of rays ≥ 4."""
    if rays < 4:
        raise ValueError(f"a hemisphere needs at least 4 rays, got {rays}")
    rings = max(1, round(float(np.sqrt(rays / np.pi))))
    return Grid(rings, max(3, round(rays / rings)))


class Hemispheres(NamedTuple):
    """K hemispheres. radiance float32 (K, M, N, 3); nearness float32 (K, M, N): 1/r, 0 where nothing is hit; tangents float64
    (K, 2, 3): axes of their frames."""

    radiance: F32
    nearness: F32
    tangents: F64


class PolarSampler:
    """Computes records by casting rays. counters: `rays` and `records` are added to."""

    equal_solid_angle = False  # cells of equal projected solid angle, which irradiance weights all alike

    def __init__(
        self, world: World, grid: Grid, incoming: Incoming, seed: int = 0, jitter: bool = True, counters: Counter[str] | None = None
    ) -> None:
        self.world, self.grid, self.counters = world, grid, Counter[str]() if counters is None else counters
        self._incoming, self._seed, self._jitter = incoming, seed, jitter
        self._caster = caster_of(world)
        self._lattice = lattice(grid.cells, 6)

    def __call__(self, sites: Sites, first: int = 0) -> Records:
        """Records at N places, numbered from `first` on; their radius is the harmonic mean distance as it is, possibly ∞."""
        size = max(1, RAYS_PER_TASK // self.grid.cells)

        def task(part: slice) -> tuple[Records, int]:
            here = sites.rows(part)
            cast, rays = self.hemispheres(here, first + part.start)
            return self.summed(here, cast), rays

        done = in_threads(task, chunks(len(sites.position), size))
        self.counters["rays"] += sum(rays for _, rays in done)
        self.counters["records"] += len(sites.position)
        return Records.joined([records for records, _ in done])

    def summed(self, sites: Sites, cast: Hemispheres) -> Records:
        """Records of places, from their hemispheres."""
        return records_of(sites, cast.tangents, polar_moments(cast.radiance, cast.nearness))

    def hemispheres(self, sites: Sites, first: int = 0) -> tuple[Hemispheres, int]:
        """All cells of a few hemispheres, and the number of rays cast. In the calling thread up to RAYS_PER_TASK rays."""
        count, grid = len(sites.position), self.grid
        tangents = np.stack(frame(sites.normal), axis=1)
        random = self._random(first, count)
        origins, directions = self._rays(sites, tangents, random)
        hits = self._caster.first_hit(origins, directions, grid)
        seen = seen_along(self.world, directions, hits)
        radiance = np.zeros((count * grid.cells, 3), np.float32)
        radiance[seen.ray], shadow_rays = self._incoming(seen, self._light_numbers(seen, random))
        nearness = np.zeros(count * grid.cells, np.float32)
        nearness[seen.ray] = 1 / np.maximum(hits.t[seen.ray], OFFSET)
        shape = count, grid.rings, grid.sectors
        return Hemispheres(radiance.reshape(*shape, 3), nearness.reshape(shape), tangents), len(origins) + shadow_rays

    def distances(self, sites: Sites) -> F64:
        """Harmonic mean distance alone, (N,), ∞ where nothing is hit: no light, no jitter."""
        tangents = np.stack(frame(sites.normal), axis=1)
        origins, directions = self._rays(sites, tangents, np.full((len(sites.position), 8), 0.5))
        hits = self._caster.first_hit(origins, directions, self.grid)
        near = np.where(hits.triangle >= 0, 1 / np.maximum(hits.t, OFFSET), 0).reshape(len(sites.position), -1)
        self.counters["rays"] += len(origins)
        mean = near.mean(axis=1, dtype=np.float64)
        return np.where(mean > 0, 1 / np.maximum(mean, 1e-300), np.inf)

    def _random(self, first: int, count: int) -> F64:
        """Numbers of each record, (K, 8): six for its lights, two that start its jitter."""
        return np.stack([numbers_of(self._seed, first + k) for k in range(count)])

    def _light_numbers(self, seen: Seen, random: F64) -> F64:
        numbers = np.empty((len(seen.ray), 6))
        _shifted(seen.ray, self._lattice, random, numbers)
        return numbers

    def _rays(self, sites: Sites, tangents: F64, random: F64) -> tuple[F32, F32]:
        shape = len(sites.position) * self.grid.cells, 3
        origins, directions = np.empty(shape, np.float32), np.empty(shape, np.float32)
        _polar_rays(
            *sites, tangents, *self.grid, self.equal_solid_angle, self._jitter, random[:, 6:], OFFSET, origins, directions
        )  # fmt: skip
        return origins, directions


@lru_cache(maxsize=1 << 14)
def numbers_of(seed: int, number: int) -> F64:
    """The random numbers (8,), not to be written to, of the record or place of a number: kept, since frames ask again and again."""
    return generator(seed, f"record {number}").random(8)


def records_of(sites: Sites, tangents: F64, moments: Moments) -> Records:
    """Records in World axes from moments in the frames of their hemispheres."""
    return Records(
        position=sites.position,
        normal=sites.normal,
        radius=moments.radius,
        irradiance=moments.irradiance,
        translation=moments.translation @ tangents,
        rotation=moments.rotation @ tangents,
        curvature=moments.curvature,
        clearance=moments.clearance,
    )


@numba.njit(nogil=True, cache=True)
def _shifted(ray, lattice, random, numbers):  # type: ignore[no-untyped-def]
    """numbers (S, 6): the lattice point of each hit's cell, moved by the numbers of its record, modulo 1."""
    for s in range(len(ray)):
        record, cell = ray[s] // len(lattice), ray[s] % len(lattice)
        for d in range(6):
            moved = lattice[cell, d] + random[record, d]
            numbers[s, d] = moved - 1 if moved >= 1 else moved


@numba.njit(inline="always")
def _turn(x):  # type: ignore[no-untyped-def]
    """cos x and sin x to 2·10⁻¹² for |x| ≤ π/3, by Taylor's series: half a sector of three, the fewest there are."""
    q = x * x
    cosine = 1 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * (-1 / 3628800 + q / 479001600)))))
    sine = x * (1 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 + q * (-1 / 39916800 + q / 6227020800))))))
    return cosine, sine


@numba.njit(nogil=True, cache=True)
def _polar_rays(position, normal, geometric, tangents, rings, sectors, solid, jitter, shifts, offset, origins, directions):  # type: ignore[no-untyped-def]
    """Rays through the cells of hemispheres, cell (j, k) met at (a, b) of its height and width, (½, ½) without jitter.

    a follows the golden-ratio sequence along each ring, b along each sector, moved by random numbers of the record, shifts (K, 2),
    modulo 1. So an edge along a ring or a sector is met at evenly spread places, where independent numbers would leave noise.
    """
    ray, step = 0, 2 * np.pi / sectors
    across_ring, across_sector = np.arange(sectors) * GOLDEN % 1.0, np.arange(rings) * GOLDEN % 1.0
    middle = step * (np.arange(sectors) + 0.5)
    cosines, sines = np.cos(middle), np.sin(middle)
    for record in range(len(position)):
        n, g, s, t = normal[record], geometric[record], tangents[record, 0], tangents[record, 1]
        for j in range(rings):
            for k in range(sectors):
                a = b = 0.5
                if jitter:
                    a, b = shifts[record, 0] + across_ring[k], shifts[record, 1] + across_sector[j]
                    a, b = a - 1 if a >= 1 else a, b - 1 if b >= 1 else b
                square = (j + a) / rings
                square = square * (2 - square) if solid else square  # sin² θ, with cos θ = 1 - (j + a) / M
                sine, cosine = np.sqrt(square), np.sqrt(1 - square)
                along, across = _turn(step * (b - 0.5))
                x, y = sine * (cosines[k] * along - sines[k] * across), sine * (sines[k] * along + cosines[k] * across)
                side = 0.0
                for c in range(3):
                    d = x * s[c] + y * t[c] + cosine * n[c]
                    directions[ray, c] = d
                    side += d * g[c]
                move = offset if side >= 0 else -offset
                for c in range(3):
                    origins[ray, c] = position[record, c] + move * g[c]
                ray += 1
