"""Photon tracing in batches: rays through Embree, scattering with Russian roulette, every hit stored.

A stored photon's flux is what its surface receives as seen by the *shading* normal (cosine at n_s over cosine at n_g, Veach
1997 §5.3), so that Σ Φ / A is the irradiance a shading normal sees. Flat shading makes the factor 1. A photon goes
on with probability q = min(1, max Φ' / max Φ), Φ' the flux after reflection: for Lambert q = ρ, and grey photons keep equal flux.

Random numbers come by photon index and bounce, batches are joined in order: the same map at any thread count.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import evaluate, materials_at
from renderers.transport.lobes import sample_brdf, sampling_pdf
from renderers.transport.photons.counter_random import key_of, numbers
from renderers.transport.photons.emission import DIMENSIONS, Sources
from renderers.transport.photons.kernels import arrive, next_rays, scatter_lambert
from renderers.transport.raycast import OFFSET, RayCaster, caster_of
from renderers.transport.surface import base_color
from renderers.transport.threads import in_threads

F32 = NDArray[np.float32]
BATCH = 1 << 14
GROUP = 4
MOST_BOUNCES = 1000
MOST_STORED = 20_000_000
PER_BOUNCE = 4


class Photons(NamedTuple):
    """Stored photons, one row each. Flux is already divided by the photons emitted: Σ Φ / area is irradiance in W·m⁻².

    position, direction, flux, normal float32 (N, 3): direction is unit, towards where the photon came from; normal is the unit
    shading normal, turned to the side the photon came from. distance float32 (N,): way since the last reflection. bounce int16
    (N,): reflections before this hit, 0 straight from a light. triangle int32 (N,): row of World.triangles that was hit.
    Positions and distances are in World units, and so is flux (W · scale²).
    """

    position: F32
    direction: F32
    flux: F32
    distance: F32
    normal: F32
    bounce: NDArray[np.int16]
    triangle: NDArray[np.int32]

    def rows(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Photons:
        """The selected photons."""
        columns: list[Any] = [column[index] for column in self]
        return Photons(*columns)

    def scaled(self, factor: float) -> Photons:
        """The same photons with fluxes times `factor`."""
        flux = self.flux * np.float32(factor)
        return Photons(self.position, self.direction, flux, self.distance, self.normal, self.bounce, self.triangle)

    def __len__(self) -> int:
        """Number of photons."""
        return int(self.position.shape[0])


class Traced(NamedTuple):
    """What tracing gave: photons in order of batch, bounce and index; emitted: N_e; flux (3,) float64: emitted, W.

    capped: paths cut at MOST_BOUNCES; full: tracing ended early because `most_stored` was reached.
    """

    photons: Photons
    emitted: int
    flux: NDArray[np.float64]
    capped: int
    full: bool


def trace(
    world: World,
    emitted: int,
    seed: int = 0,
    direct: bool = False,
    most_stored: int = MOST_STORED,
    first: int = 0,
    counters: Counter[str] | None = None,
) -> Traced:
    """Trace photons first … first + emitted - 1. direct: keep those that come straight from a light (bounce 0) as well.

    Memory is bounded: once `most_stored` photons are kept, tracing ends after the batches under way, and N_e is what was emitted
    till then. counters: `photons_emitted`, `photons_stored`, `rays`.
    """
    sources, caster = Sources(world), caster_of(world)
    key, scatter = key_of(seed, "photon emission"), key_of(seed, "photon scattering")
    starts = range(first, first + emitted, BATCH) if not sources.dark else range(0)
    batches: list[_Batch] = []
    stored = done = 0
    for group in range(0, len(starts), GROUP):
        parts = [(a, min(a + BATCH, first + emitted)) for a in starts[group : group + GROUP]]
        batches += in_threads(lambda part: _batch(world, sources, caster, (key, scatter), part, 0 if direct else 1), parts)
        stored = sum(len(b.photons) for b in batches)
        done = parts[-1][1] - first
        if stored >= most_stored:
            break
    full = stored >= most_stored and done < emitted
    count = done if full else emitted
    if counters is not None:
        counters["photons_emitted"] += count
        counters["photons_stored"] += stored
        counters["rays"] += sum(b.rays for b in batches)
    flux = np.sum([b.flux for b in batches], axis=0) / max(count, 1) if batches else np.zeros(3)
    capped = sum(b.capped for b in batches)
    photons = _joined([b.photons for b in batches], count)
    return Traced(photons, count, flux, capped, full)


class _Batch(NamedTuple):
    photons: Photons
    flux: NDArray[np.float64]
    rays: int
    capped: int


def _batch(
    world: World, sources: Sources, caster: RayCaster, keys: tuple[np.uint64, np.uint64], part: tuple[int, int], keep: int
) -> _Batch:
    """Photons of the indices part[0] … part[1]-1, flux not yet divided by N_e."""
    index = np.arange(part[0], part[1], dtype=np.uint64)
    rays = sources.emit(keys[0], index)
    origin, direction, flux = (np.ascontiguousarray(column, np.float32) for column in rays)
    found: list[Photons] = []
    cast, bounce = 0, 0
    while len(index) and bounce < MOST_BOUNCES:
        cast += len(index)
        hits = caster.first_hit(origin, direction)
        rows = np.flatnonzero(hits.triangle >= 0)
        index, direction, flux = index[rows], direction[rows], flux[rows]
        triangle, u, v, t = hits.triangle[rows], hits.u[rows], hits.v[rows], hits.t[rows]
        position, came, received, normal, geometric = (np.empty((len(rows), 3), np.float32) for _ in range(5))
        arrive(
            world.positions, world.normals, world.triangles, world.face_normals, triangle, u, v, direction, flux,
            position, came, received, normal, geometric,
        )  # fmt: skip
        photons = Photons(position, came, received, t, normal, np.full(len(rows), bounce, np.int16), triangle)
        if bounce >= keep:
            found.append(photons)
        index, origin, direction, flux = _reflected(world, photons, geometric, u, v, index, keys[1])
        bounce += 1
    return _Batch(_joined(found, 1), rays.flux.sum(axis=0), cast, len(index))


def _reflected(
    world: World,
    photons: Photons,
    geometric: F32,
    u: F32,
    v: F32,
    index: NDArray[np.uint64],
    key: np.uint64,
) -> tuple[NDArray[np.uint64], F32, F32, F32]:
    """Indices, origins, directions and fluxes of the photons that go on."""
    if not len(photons):
        return index, photons.position, photons.direction, photons.flux
    material = world.material[photons.triangle]
    base = world.materials.base[material]
    textured = np.flatnonzero(world.materials.texture[material] >= 0)
    if len(textured):
        corners = world.uvs[world.triangles[photons.triangle[textured]]]
        a, b = u[textured, None], v[textured, None]
        uv = ((1 - a - b) * corners[:, 0] + a * corners[:, 1] + b * corners[:, 2]).astype(np.float64)
        base[textured] = base_color(world, material[textured], uv)
    direction, flux = np.empty_like(photons.direction), np.empty_like(photons.flux)
    first = DIMENSIONS + PER_BOUNCE * int(photons.bounce[0])
    scatter_lambert(key, index, first, photons.normal, geometric, base, photons.flux, direction, flux)
    glossy = np.flatnonzero(world.materials.kind[material] != LAMBERT)
    if len(glossy):
        m = materials_at(world.materials, material[glossy], base[glossy])
        n, came = (column[glossy].astype(np.float64) for column in (photons.normal, photons.direction))
        leaving = sample_brdf(m, n, came, numbers(key, index[glossy], first, 3))
        density = sampling_pdf(m, n, came, leaving)
        # f · |ω_o·n_g| / p: the cosine a particle leaves by is the geometric one (Veach 1997 §5.3)
        cosine = np.abs(np.einsum("ij,ij->i", geometric[glossy].astype(np.float64), leaving))
        weight = evaluate(m, n, leaving, came) * (cosine / np.maximum(density, 1e-12))[:, None]
        direction[glossy], flux[glossy] = leaving, photons.flux[glossy] * weight
    origin = np.empty_like(direction)
    count = next_rays(key, index, first + 3, photons.position, geometric, photons.flux, origin, direction, flux, np.float32(OFFSET))
    return index[:count], origin[:count], direction[:count], flux[:count]


def _joined(parts: list[Photons], emitted: int) -> Photons:
    """One column after the other, so that at most one is held twice; fluxes divided by `emitted`."""
    if not parts:
        three, one = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        return Photons(three, three, three, one, three, np.zeros(0, np.int16), np.zeros(0, np.int32))
    columns = [list(column) for column in zip(*parts, strict=True)]
    parts.clear()
    joined: list[Any] = []
    for column in columns:
        joined.append(np.concatenate(column))
        column.clear()
    if emitted != 1:
        joined[2] /= np.float32(emitted)
    return Photons(*joined)
