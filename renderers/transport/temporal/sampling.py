"""Polar hemispheres whose hits are kept, so that the same hemisphere can be foreseen one frame ahead.

A place has a number for all its life, and its hemisphere the jitter and the light samples of that number in every frame: in a scene
at rest a renewed record has the bytes of the one before, and in a moving one the noise of successive records cancels in their
differences.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.gradients import polar_moments
from renderers.transport.caching.hemisphere import RAYS_PER_TASK, Grid, PolarSampler, records_of
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.records import Records, Sites
from renderers.transport.raycast import OFFSET, Hits
from renderers.transport.sampling import frame, generator
from renderers.transport.seen import Seen, seen_along
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Cast(NamedTuple):
    """Hemispheres of K places with all that was found on the way. Rays are numbered record by record, cell by cell.

    origins, directions float32 (K·cells, 3); hits: of the rays; seen: of those that hit something; random float64 (K, 8): numbers
    of the places; radiance float32 (K·cells, 3), nearness float32 (K·cells,); tangents float64 (K, 2, 3).
    """

    sites: Sites
    tangents: F64
    origins: F32
    directions: F32
    hits: Hits
    seen: Seen
    random: F64
    radiance: F32
    nearness: F32


class Ahead(Protocol):
    """Foresees hemispheres one frame later."""

    def __call__(self, cast: Cast) -> tuple[F32, F32, int]:
        """Radiance (K·cells, 3), nearness (K·cells,) one frame later, and the number of rays cast. Called from several threads."""


class TemporalSampler(PolarSampler):
    """Computes records at places with numbers of their own, and the same records one frame ahead. Counters as `PolarSampler`."""

    def __init__(self, world: World, grid: Grid, incoming: Incoming, seed: int, counters: Counter[str]) -> None:
        super().__init__(world, grid, incoming, seed, counters=counters)

    def sample(self, sites: Sites, places: I64, ahead: Ahead | None = None) -> tuple[Records, Records]:
        """Records at N places numbered `places` (N,), and what they will be one frame later; without `ahead`, what they are now."""
        size = max(1, RAYS_PER_TASK // self.grid.cells)

        def task(part: slice) -> tuple[Records, Records, int]:
            cast, rays = self.cast(sites.rows(part), places[part])
            now = self._records(cast, cast.radiance, cast.nearness)
            if ahead is None:
                return now, now, rays
            radiance, nearness, more = ahead(cast)
            return now, self._records(cast, radiance, nearness), rays + more

        done = in_threads(task, chunks(len(sites.position), size))
        self.counters["rays"] += sum(rays for _, _, rays in done)
        self.counters["records"] += len(sites.position)
        self.counters["predictions"] += 0 if ahead is None else len(sites.position)
        return Records.joined([now for now, _, _ in done]), Records.joined([later for _, later, _ in done])

    def cast(self, sites: Sites, places: I64) -> tuple[Cast, int]:
        """The hemispheres of a few places, and the number of rays cast. In the calling thread up to RAYS_PER_TASK rays."""
        cells = len(places) * self.grid.cells
        tangents = np.stack(frame(sites.normal), axis=1)
        random = np.stack([generator(self._seed, f"record {place}").random(8) for place in places])
        origins, directions = self._rays(sites, tangents, random)
        hits = self._caster.first_hit(origins, directions)
        seen = seen_along(self.world, directions, hits)
        radiance, nearness = np.zeros((cells, 3), np.float32), np.zeros(cells, np.float32)
        radiance[seen.ray], shadow_rays = self._incoming(seen, self._light_numbers(seen, random))
        nearness[seen.ray] = 1 / np.maximum(hits.t[seen.ray], OFFSET)
        return Cast(sites, tangents, origins, directions, hits, seen, random, radiance, nearness), cells + shadow_rays

    def light_numbers(self, seen: Seen, random: F64) -> F64:
        """Random numbers float64 (S, 6) for the lights of hits, whose rays belong to places with numbers (K, 8)."""
        return self._light_numbers(seen, random)

    def _records(self, cast: Cast, radiance: F32, nearness: F32) -> Records:
        shape = len(cast.tangents), *self.grid
        return records_of(cast.sites, cast.tangents, polar_moments(radiance.reshape(*shape, 3), nearness.reshape(shape)))
