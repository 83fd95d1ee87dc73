"""Records from hemicubes: what five faces of texels see, cast by rays through their centres or drawn by a rasteriser.

A rasteriser answers with the triangle that each texel sees; where its ray meets it, how far away and how it is lit is then computed
as for any ray. Or it answers with the light as well.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA
from renderers.scene.world import World
from renderers.transport.caching.cube import cube_tables, harmonic_tables
from renderers.transport.caching.gradients import Moments
from renderers.transport.caching.hemisphere import RAYS_PER_TASK, Grid, Hemispheres, PolarSampler, records_of
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.radiance import RadianceMoments, radiance_records
from renderers.transport.caching.records import Records, Sites
from renderers.transport.raycast import OFFSET, Hits
from renderers.transport.sampling import frame
from renderers.transport.seen import seen_along
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Rasteriser(Protocol):
    """Draws hemicubes, with their light or without, in the thread that made it."""

    def batch(self, size: int) -> int:
        """How many are drawn at once."""

    def __call__(self, eyes: F64, lifts: F64, axes: F64, size: int, counters: Counter[str]) -> NDArray[Any]:
        """Triangles int32 (K, P), -1 where nothing is, or radiance and 1/r float32 (K, P, 4), of hemicubes at eyes (K, 3).

        lifts (K, 3): unit, the way the eyes were lifted off their surfaces. axes (K, 3, 3): tangents and normals. P = 3 size².
        counters: `draw_calls` is added to.
        """


def cube_moments(radiance: NDArray[np.floating], nearness: NDArray[np.floating], size: int) -> Moments:
    """Moments of K hemicubes with radiance (K, P, 3) and nearness 1/r (K, P), 0 where nothing is hit (R = ∞ if nowhere)."""
    count = len(nearness)
    out = Moments(
        np.zeros((count, 3)), np.zeros((count, 3, 2)), np.zeros((count, 3, 2)), np.full(count, np.inf), np.zeros((count, 3))
    )
    _cubes(radiance, nearness, cube_tables(size), LUMA, *out[:5])
    return out


def cube_radiance_moments(radiance: NDArray[np.floating], nearness: NDArray[np.floating], size: int, order: int) -> RadianceMoments:
    """Coefficients of K hemicubes, with their gradients; see `cube_moments`."""
    count, tables, harmonics = len(nearness), cube_tables(size), harmonic_tables(size, order)
    light = np.asarray(radiance, np.float32)
    a, b = tables.first, tables.second
    swept = np.maximum(nearness[:, a], nearness[:, b])[..., None] * (light[:, b] - light[:, a])
    coefficients = np.matmul(harmonics.inside, light).astype(np.float64)
    gradients = np.matmul(harmonics.sweep, swept.astype(np.float32)).astype(np.float64)
    near = nearness.astype(np.float64) @ tables.cosine
    return RadianceMoments(
        coefficients,
        gradients.reshape(count, 2, order**2, 3),
        np.einsum("kpc,pt->kct", light.astype(np.float64), tables.turn),
        np.where(near > 0, np.pi / np.where(near > 0, near, 1), np.inf),
    )


class HemicubeSampler(PolarSampler):
    """Computes records from hemicubes; in use like a `PolarSampler`.

    size: texels along a face's side, even (`cube.size_of` a number of samples). order: of radiance records; None: of irradiance.
    rasteriser: draws them; None: rays are cast.
    """

    def __init__(
        self, world: World, size: int, incoming: Incoming, seed: int = 0, order: int | None = None,
        rasteriser: Rasteriser | None = None, counters: Counter[str] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(world, Grid(3 * size, size), incoming, seed, False, counters)
        self._size, self._order, self._rasteriser = size, order, rasteriser
        self._local = cube_tables(size).direction
        self._corners = world.positions, world.triangles

    def __call__(self, sites: Sites, first: int = 0) -> Records:
        """See `PolarSampler.__call__`. Drawn hemicubes count as `texels`, not as `rays`."""
        if self._rasteriser is None:
            return super().__call__(sites, first)
        done: list[tuple[Records, int]] = []
        for part in chunks(len(sites.position), self._rasteriser.batch(self._size)):
            done += self._of_drawn(sites.rows(part), first + part.start, self._rasteriser)
        self.counters["rays"] += sum(rays for _, rays in done)
        self.counters["records"] += len(sites.position)
        self.counters["texels"] += len(sites.position) * self.grid.cells
        return Records.joined([records for records, _ in done])

    def _of_drawn(self, sites: Sites, first: int, rasteriser: Rasteriser) -> list[tuple[Records, int]]:
        """Records of one batch in parts, and the rays cast for each."""
        tangents, side = np.stack(frame(sites.normal), axis=1), np.einsum("kd,kd->k", sites.normal, sites.geometric)
        lifts = np.where(side < 0, -1.0, 1.0)[:, None] * sites.geometric
        axes = np.concatenate([tangents, sites.normal[:, None]], axis=1)
        drawn = rasteriser(sites.position + OFFSET * lifts, lifts, axes, self._size, self.counters)

        def task(part: slice) -> tuple[Records, int]:
            here = sites.rows(part)
            cast, rays = self._seen(here, tangents[part], drawn[part], first + part.start)
            return self.summed(here, cast), rays

        return in_threads(task, chunks(len(sites.position), max(1, RAYS_PER_TASK // self.grid.cells)))

    def summed(self, sites: Sites, cast: Hemispheres) -> Records:
        """See `PolarSampler.summed`."""
        count = len(sites.position)
        radiance, nearness = cast.radiance.reshape(count, -1, 3), cast.nearness.reshape(count, -1)
        if self._order is None:
            return records_of(sites, cast.tangents, cube_moments(radiance, nearness, self._size))
        return radiance_records(sites, cast.tangents, cube_radiance_moments(radiance, nearness, self._size, self._order))

    def _seen(self, sites: Sites, tangents: F64, drawn: NDArray[Any], first: int) -> tuple[Hemispheres, int]:
        """Light and distances of drawn hemicubes, and the number of rays cast for them."""
        count, cells = len(sites.position), self.grid.cells
        shape = count, self.grid.rings, self.grid.sectors
        if drawn.ndim == 3:
            return Hemispheres(drawn[..., :3].reshape(*shape, 3), drawn[..., 3].reshape(shape), tangents), 0
        random = self._random(first, count)
        origins, directions = self._rays(sites, tangents, random)
        hits = Hits(drawn.reshape(-1).copy(), *np.zeros((3, count * cells), np.float32))
        _meet(origins, directions, *self._corners, hits)
        seen = seen_along(self.world, directions, hits)
        radiance, nearness = np.zeros((count * cells, 3), np.float32), np.zeros(count * cells, np.float32)
        radiance[seen.ray], rays = self._incoming(seen, self._light_numbers(seen, random))
        nearness[seen.ray] = 1 / np.maximum(hits.t[seen.ray], OFFSET)
        return Hemispheres(radiance.reshape(*shape, 3), nearness.reshape(shape), tangents), rays

    def _rays(self, sites: Sites, tangents: F64, random: F64) -> tuple[F32, F32]:
        axes = np.concatenate([tangents, sites.normal[:, None]], axis=1)
        directions = np.einsum("pt,ktd->kpd", self._local, axes)
        side = np.where(np.einsum("kpd,kd->kp", directions, sites.geometric) >= 0, OFFSET, -OFFSET)
        origins = sites.position[:, None] + side[..., None] * sites.geometric[:, None]
        return origins.reshape(-1, 3).astype(np.float32), directions.reshape(-1, 3).astype(np.float32)


@numba.njit(nogil=True, cache=True)
def _meet(origins, directions, positions, triangles, hits):  # type: ignore[no-untyped-def]
    """Fill t, u, v of rays whose triangles are known (Möller & Trumbore 1997).

    A rasteriser's edges and those of rays differ by rounding: barycentrics are brought back into the triangle. A triangle seen on
    edge has no place: its hit is taken back.
    """
    e, f, away = np.empty(3), np.empty(3), np.empty(3)
    for r in range(len(origins)):
        t = hits.triangle[r]
        if t < 0:
            continue
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        for x in range(3):
            e[x] = float(positions[b, x]) - float(positions[a, x])
            f[x] = float(positions[c, x]) - float(positions[a, x])
            away[x] = float(origins[r, x]) - float(positions[a, x])
        d = directions[r]
        px, py, pz = d[1] * f[2] - d[2] * f[1], d[2] * f[0] - d[0] * f[2], d[0] * f[1] - d[1] * f[0]
        qx, qy, qz = away[1] * e[2] - away[2] * e[1], away[2] * e[0] - away[0] * e[2], away[0] * e[1] - away[1] * e[0]
        facing = e[0] * px + e[1] * py + e[2] * pz
        distance = f[0] * qx + f[1] * qy + f[2] * qz
        if facing == 0 or distance * facing <= 0:
            hits.triangle[r] = -1
            continue
        u = min(max((away[0] * px + away[1] * py + away[2] * pz) / facing, 0.0), 1.0)
        hits.t[r], hits.u[r] = distance / facing, u
        hits.v[r] = min(max((d[0] * qx + d[1] * qy + d[2] * qz) / facing, 0.0), 1 - u)


@numba.njit(nogil=True, cache=True)
def _cubes(radiance, nearness, tables, luma, irradiance, translation, rotation, radius, hessian):  # type: ignore[no-untyped-def]
    for record in range(len(nearness)):
        light, near = radiance[record], nearness[record]
        total = 0.0
        for p in range(len(near)):
            total += tables.cosine[p] * near[p]
            for c in range(3):
                irradiance[record, c] += tables.cosine[p] * light[p, c]
                rotation[record, c, 0] += tables.turn[p, 0] * light[p, c]
                rotation[record, c, 1] += tables.turn[p, 1] * light[p, c]
        if total > 0:
            radius[record] = np.pi / total
        for e in range(len(tables.first)):
            a, b = tables.first[e], tables.second[e]
            nearer = max(near[a], near[b])
            bright = 0.0
            for c in range(3):
                step = nearer * (float(light[b, c]) - float(light[a, c]))
                translation[record, c, 0] += tables.sweep[e, 0] * step
                translation[record, c, 1] += tables.sweep[e, 1] * step
                bright += luma[c] * step
            for k in range(3):
                hessian[record, k] += tables.bend[e, k] * nearer * bright
