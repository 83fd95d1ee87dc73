"""Lobes that records don't hold: importance-sampled rays from every pixel, shaded like those of a hemisphere.

    L(p, v) = 1/N Σ L_i(ω_s) f_lobe(v, ω_s) cos θ_s / pdf(ω_s),      ω_s of the lobe's own distribution (`transport.lobes`)

Of lobes too sharp for any record only these are traced: the diffuse term of such a surface is smooth and comes from irradiance
records. Glossy pixels too few for a radiance record of N rays, fewer than P, are traced with all their terms, by N/2P rays each: a
traced ray costs about two of a record's (`few_at`). LOBE of them go along the lobe, the others by the cosine.

Directions are a Fibonacci lattice in the square that a lobe is the image of, moved at random pixel by pixel, by the same numbers in
every frame and whichever other pixels are traced. Against one of nine dimensions, which serves lights too, it has an eighth
to a half of the error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import GGX_KIND, PHONG, World
from renderers.transport.brdf import Materials, evaluate, ggx_colors, materials_at
from renderers.transport.caching.hemisphere import GOLDEN
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.reflectance import Gloss
from renderers.transport.direct import receivers_of
from renderers.transport.lobes import sample_brdf, sampling_pdf
from renderers.transport.raycast import caster_of, off_surface
from renderers.transport.sampling import cosine_hemisphere, generator, lattice
from renderers.transport.seen import seen_along
from renderers.transport.threads import chunks, in_threads

F64 = NDArray[np.float64]
Towards = Callable[[Materials, F64, F64, F64], tuple[F64, F64]]
RAYS_PER_TASK = 1 << 15
PIXELS_PER_DRAW = 1 << 14
LOBE = 2 / 3
LEAST = 1024  # error of a twentieth on small glossy things, half of what interpolation and truncation leave beside them


def traced_lobes(
    world: World,
    gbuffer: GBuffer,
    rows: NDArray[np.intp],
    rays: int,
    incoming: Incoming,
    seed: int = 0,
    counters: Counter[str] | None = None,
) -> F64:
    """Radiance float64 (P, 3) that the lobes of pixels (flat indices) reflect; counters: `lobe_rays`, with shadow rays, grows."""
    return _Pixels(world, gbuffer, rows, incoming, seed).traced(_of_lobes, rays, "lobes", counters)


class Price(NamedTuple):
    """What a radiance record costs. rays: its own; fewest: pixels that one is made for, None: by their lobes, see `few_at`."""

    rays: int
    fewest: int | None


def few_at(gloss: Gloss, gbuffer: GBuffer, rows: NDArray[np.intp], price: Price) -> F64:
    """Fewest pixels that a radiance record is made for, at cached pixels (flat indices): P, (P,).

    Of a record's rays the share `LobeTable.fill` meets a lobe. As many for each pixel, but LEAST at least, leave no more noise;
    each costs about two of a record's, so that P pixels by N/2P rays are as dear as one record by N.
    """
    if price.fewest is not None:
        return np.full(len(rows), float(price.fewest))
    return np.minimum(0.5 / gloss.fill[gloss.shape[gbuffer.material.ravel()[rows]]], 0.5 * price.rays / LEAST)


def traced_alone(
    world: World,
    gbuffer: GBuffer,
    rows: NDArray[np.intp],
    gloss: Gloss,
    price: Price,
    incoming: Incoming,
    seed: int = 0,
    counters: Counter[str] | None = None,
) -> F64:
    """Radiance float64 (P, 3) that cached pixels (flat indices, ascending) reflect, all terms, in place of a record of that price;
    counters: `lobe_rays` and `pixels_alone` are added to."""
    light, few = np.zeros((len(rows), 3)), few_at(gloss, gbuffer, rows, price)
    for number in np.unique(few):
        index = np.flatnonzero(few == number)
        pixels = _Pixels(world, gbuffer, rows[index], incoming, seed)
        share = price.rays / (2 * number)
        light[index] = pixels.traced(_of_lobes, max(1, round(LOBE * share)), "lobes", counters)
        light[index] += pixels.traced(_of_diffuse_terms, max(1, round((1 - LOBE) * share)), "diffuse terms", counters)
    if counters is not None:
        counters["pixels_alone"] += len(rows)
    return light


class _Pixels:
    """Pixels (flat indices) of a G-buffer, with what tracing them needs."""

    def __init__(self, world: World, gbuffer: GBuffer, rows: NDArray[np.intp], incoming: Incoming, seed: int) -> None:
        self.world, self.incoming, self.rows = world, incoming, rows
        self.receivers, self._seed = receivers_of(world, gbuffer, rows), seed
        view = gbuffer.eye - self.receivers.position
        self.view = view / np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
        self.materials = materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows])

    def traced(self, towards: Towards, rays: int, name: str, counters: Counter[str] | None) -> F64:
        """Radiance (P, 3) that comes by so many rays each, `towards` directions of its choice; name: of their random numbers."""
        shifts, points = numbers_of_pixels(self._seed, name, self.rows), directions_and_lights(rays)

        def task(part: slice) -> tuple[F64, int]:
            numbers = (points[None] + shifts[part, None]) % 1.0
            return self._brought(part, towards, numbers)

        done = in_threads(task, chunks(len(self.rows), max(1, RAYS_PER_TASK // rays)))
        if counters is not None:
            counters["lobe_rays"] += sum(cast for _, cast in done)
        return np.concatenate([light for light, _ in done]) if done else np.zeros((0, 3))

    def _brought(self, part: slice, towards: Towards, numbers: F64) -> tuple[F64, int]:
        """Radiance (P, 3) of some pixels by numbers (P, rays, 9), and the rays cast for it."""
        count, rays = numbers.shape[:2]
        pixel, flat = np.repeat(np.arange(part.start, part.start + count), rays), numbers.reshape(-1, 9)
        receivers = self.receivers
        direction, weight = towards(self.materials.rows(pixel), receivers.normal[pixel], self.view[pixel], flat[:, :3])
        live = np.flatnonzero(weight.any(axis=1))
        origin = off_surface(receivers.position[pixel[live]], receivers.geometric[pixel[live]], direction[live])
        aim = direction[live].astype(np.float32)
        seen = seen_along(self.world, aim, caster_of(self.world).first_hit(origin, aim))
        radiance, shadow_rays = self.incoming(seen, flat[live[seen.ray], 3:])
        light = np.zeros((count, 3))
        np.add.at(light, pixel[live[seen.ray]] - part.start, weight[live[seen.ray]] * radiance)
        return light / rays, len(live) + shadow_rays


def numbers_of_pixels(seed: int, name: str, rows: NDArray[np.intp]) -> F64:
    """Random numbers (P, 9) of pixels (flat indices, ascending): each has its own, whichever others are asked for."""
    stream, found = generator(seed, name), np.empty((len(rows), 9))
    for part in chunks(int(rows[-1]) + 1 if len(rows) else 0, PIXELS_PER_DRAW):
        here = slice(*np.searchsorted(rows, (part.start, part.stop)))
        found[here] = stream.random((PIXELS_PER_DRAW, 9))[rows[here] - part.start]
    return found


def directions_and_lights(rays: int) -> F64:
    """Points (rays, 9) in the unit cube: choice of a lobe, direction (a Fibonacci lattice), light samples."""
    number = np.arange(rays)
    points = lattice(rays, 9)
    points[:, 1], points[:, 2] = (number + 0.5) / rays, number * GOLDEN % 1.0
    return points


def _of_lobes(m: Materials, n: F64, view: F64, random: F64) -> tuple[F64, F64]:
    """Directions (N, 3) by the lobes, and what they reflect of radiance from there, over the density (N, 3)."""
    lobes = lobes_alone(m)
    direction = sample_brdf(lobes, n, view, random)
    pdf, cosine = sampling_pdf(lobes, n, view, direction), np.einsum("ij,ij->i", n, direction)
    weight = np.zeros((len(n), 3))
    live = np.flatnonzero((cosine > 0) & (pdf > 0))
    weight[live] = evaluate(lobes.rows(live), n[live], direction[live], view[live]) * (cosine[live] / pdf[live])[:, None]
    return direction, weight


def _of_diffuse_terms(m: Materials, n: F64, view: F64, random: F64) -> tuple[F64, F64]:
    """The same by the cosine, for all but the lobes."""
    direction = cosine_hemisphere(n, random[:, 1:])
    both, lobes = (evaluate(each, n, direction, view) for each in (m, lobes_alone(m)))
    return direction, np.maximum(np.pi * (both - lobes), 0)


def lobes_alone(m: Materials) -> Materials:
    """The same surfaces without their diffuse terms: Phong on black, GGX as a metal of the same f0."""
    base = np.where((m.kind == PHONG)[:, None], 0.0, m.base)
    rows = np.flatnonzero(m.kind == GGX_KIND)
    base[rows] = ggx_colors(m.rows(rows))[0]
    return m._replace(base=base, metallic=np.ones_like(m.metallic))


def notes_on_lobes(gloss: Gloss | None, traced: int, rays: int) -> tuple[str, ...]:
    """What a result has to say about lobes that no record holds: `traced` pixels, by so many rays each."""
    notes = []
    if traced:
        notes.append(f"{traced} pixels have lobes too sharp for radiance records and were traced, {rays} rays each")
    if gloss is not None and gloss.truncated:
        notes.append(f"{len(gloss.truncated)} materials are too sharp for order {gloss.order}: their lobes ring")
    return tuple(notes)
