"""Hemispheres seen through one square plane (`caching.plane`), kept so that they can be foreseen: the sampling of the publication.

In use like polar ones. `PlaneReprojection` moves what a plane sees with its objects and draws it into the same plane (`plane`); the
planes of hundreds of records are drawn at once, in the calling thread, which OpenGL needs.             Gautron 2006, section 5.4.2
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.hemisphere import RAYS_PER_TASK, Grid, records_of
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.plane import HALF_WIDTH, plane_directions, plane_moments, plane_rays, plane_weights, side_of
from renderers.transport.caching.records import Records, Sites
from renderers.transport.temporal.motion import Motion
from renderers.transport.temporal.plane import Draw, reprojected
from renderers.transport.temporal.prediction import followed
from renderers.transport.temporal.sampling import Ahead, Cast, TemporalSampler
from renderers.transport.temporal.updating import Found
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]
DRAWN = 512  # records whose points are kept until they are drawn
FAR = 1e12  # depth of what misses


class TemporalPlaneSampler(TemporalSampler):
    """Computes records from rays through the pixel centres of one plane, size² each, and the same records one frame ahead."""

    def __init__(self, world: World, size: int, incoming: Incoming, seed: int, counters: Counter[str], sparse: int = 1) -> None:
        super().__init__(world, Grid(size, size), incoming, seed, counters, sparse)
        self._local = plane_directions(size)

    def sample(self, sites: Sites, places: I64, ahead: Ahead | None = None, tangents: F64 | None = None) -> tuple[Records, Records]:
        """See `TemporalSampler.sample`."""
        if not isinstance(ahead, PlaneReprojection):
            return super().sample(sites, places, ahead, tangents)
        pairs = [
            self._sample_drawn(sites.rows(part), places[part], None if tangents is None else tangents[part], ahead)
            for part in chunks(len(places), DRAWN)
        ]
        self.counters["records"] += len(places)
        self.counters["predictions"] += len(places)
        return Records.joined([now for now, _ in pairs]), Records.joined([later for _, later in pairs])

    def _sample_drawn(self, sites: Sites, places: I64, tangents: F64 | None, ahead: PlaneReprojection) -> tuple[Records, Records]:
        """Cast in threads, draw in this one, sum up in threads."""
        parts = chunks(len(places), max(1, RAYS_PER_TASK // self.grid.cells))

        def cast(part: slice) -> tuple[Records, Cloud, F64, int]:
            planes, rays = self.cast(sites.rows(part), places[part], None if tangents is None else tangents[part])
            cloud, more = ahead.cloud(planes)
            return self._records(planes, planes.found), cloud, planes.tangents, rays + more

        def summed(part: int) -> Records:
            radiance, nearness = drawn[part]
            return self._summed(sites.rows(parts[part]), done[part][2], radiance, nearness, self.grid)

        done = in_threads(cast, parts)
        self.counters["rays"] += sum(rays for *_, rays in done)
        drawn = ahead.drawn([cloud for _, cloud, *_ in done])
        return Records.joined([now for now, *_ in done]), Records.joined(in_threads(summed, range(len(parts))))

    def _rays(self, sites: Sites, tangents: F64, random: F64) -> tuple[F32, F32]:
        return plane_rays(self._local, sites, tangents)

    def _records(self, cast: Cast, found: Found, grid: Grid | None = None) -> Records:
        return self._summed(cast.sites, cast.tangents, found.radiance, found.nearness, self.grid if grid is None else grid)

    @staticmethod
    def _summed(sites: Sites, tangents: F64, radiance: F32, nearness: F32, grid: Grid) -> Records:
        shape = len(tangents), *grid
        moments = plane_moments(radiance.reshape(*shape, 3), nearness.reshape(shape))
        return replace(records_of(sites, tangents, moments), curvature=None)

    @staticmethod
    def _fewer(cells: int) -> Grid:
        return Grid(side_of(cells), side_of(cells))

    @staticmethod
    def _unevenness(grid: Grid) -> float:
        return float((plane_weights(grid.rings).cosine ** 2).sum() / np.pi**2)


class Cloud(NamedTuple):
    """What K planes of N pixels see, one frame later. points float32 (K, N, 3): from their places, in the axes of the planes;
    radiance float32 (K, N, 3), of each then; nearness float32 (K, N), of each now; moves bool (K, N)."""

    points: F32
    radiance: F32
    nearness: F32
    moves: Mask


class PlaneReprojection:
    """What planes see, moved with its objects and drawn into them as points by `draw`. Needs `motion.same_topology`.

    follows: places on surfaces that move go with them.
    """

    smooth = True

    def __init__(
        self, motion: Motion, sampler: TemporalPlaneSampler, incoming: Incoming, draw: Draw = reprojected, follows: bool = True
    ) -> None:
        if not motion.same_topology:
            raise ValueError("hits can only be followed where the triangles of both frames correspond")
        self._motion, self._sampler, self._incoming = motion, sampler, incoming
        self._draw, self._follows = draw, follows
        self._local = plane_directions(sampler.grid.rings).astype(np.float32)

    def changes(self, sites: Sites) -> Mask:
        """See `sampling.Ahead`: drawing points costs much less than casting rays."""
        return np.zeros(len(sites.position), bool)

    def __call__(self, cast: Cast) -> tuple[Found, int]:
        """See `sampling.Ahead`. From the calling thread alone where `draw` needs that."""
        cloud, rays = self.cloud(cast)
        radiance, nearness = self.drawn([cloud])[0]
        return Found(cast.found.hits, radiance, nearness), rays

    def cloud(self, cast: Cast) -> tuple[Cloud, int]:
        """What is to be drawn, and the number of rays cast. Called from several threads."""
        then = followed(self._motion, self._sampler, self._incoming, cast, self._follows)
        shape = len(cast.tangents), len(self._local)
        hits = cast.found.hits
        t = np.where(hits.triangle >= 0, hits.t, np.float32(FAR)).reshape(shape)
        points = self._local * t[..., None]
        rays = then.seen.ray[then.moves]
        axes = np.concatenate([cast.tangents, cast.sites.normal[:, None]], axis=1)[rays // shape[1]]
        points.reshape(-1, 3)[rays] = np.einsum("nij,nj->ni", axes, then.position[then.moves] - cast.origins[rays])
        moves = np.zeros(len(cast.origins), bool)
        moves[rays] = True
        light = then.found.radiance.reshape(*shape, 3)
        return Cloud(points, light, then.found.nearness.reshape(shape), moves.reshape(shape)), then.rays

    def drawn(self, clouds: list[Cloud]) -> list[tuple[F32, F32]]:
        """Radiance (K, N, 3) and nearness (K, N) of planes, cloud by cloud, all drawn at once."""
        stirred: list[Mask] = [np.asarray(cloud.moves.any(axis=1)) for cloud in clouds]
        points = np.concatenate([cloud.points[some] for cloud, some in zip(clouds, stirred, strict=True)])
        side = self._sampler.grid.rings
        source, depth, _ = self._draw(points, side, HALF_WIDTH) if len(points) else reprojected(points, side, HALF_WIDTH)
        ends = np.cumsum([int(some.sum()) for some in stirred])[:-1]
        flat = len(points), len(self._local)
        sources, depths = np.split(source.reshape(flat), ends), np.split(depth.reshape(flat), ends)
        return in_threads(lambda k: self._seen(clouds[k], stirred[k], sources[k], depths[k]), range(len(clouds)))

    def _seen(self, cloud: Cloud, stirred: Mask, source: NDArray[np.int32], depth: F32) -> tuple[F32, F32]:
        """Planes of a cloud, those `stirred` (K,) with what was drawn on them: source, depth (S, N)."""
        radiance, nearness = cloud.radiance.copy(), cloud.nearness.copy()
        light, near, moves = cloud.radiance[stirred], cloud.nearness[stirred], cloud.moves[stirred]
        own, known = np.arange(source.shape[1]), source >= 0
        taken = np.where(known, source, 0)
        radiance[stirred] = np.where(known[..., None], np.take_along_axis(light, taken[..., None], axis=1), 0)
        behind = known & (np.take_along_axis(near, taken, axis=1) > 0)
        redrawn = np.where(behind, self._local[:, 2] / np.where(behind, depth, 1), 0)
        nearness[stirred] = np.where((source == own) & ~moves, near, redrawn)
        return radiance, nearness
