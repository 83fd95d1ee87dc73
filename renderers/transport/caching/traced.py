"""Lobes too sharp for records: importance-sampled rays from every pixel, shaded like those of a hemisphere.

    L(p, v) = 1/N Σ L_i(ω_s) f_lobe(v, ω_s) cos θ_s / pdf(ω_s),      ω_s of the lobe's own distribution (`transport.lobes`)

Only lobes are traced: the diffuse term of such a surface is smooth and comes from irradiance records. The directions of a pixel are
a lattice moved at random, pixel by pixel.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import GGX_KIND, PHONG, World
from renderers.transport.brdf import Materials, evaluate, ggx_colors, materials_at
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.reflectance import Gloss
from renderers.transport.direct import Receivers, receivers_of
from renderers.transport.lobes import sample_brdf, sampling_pdf
from renderers.transport.raycast import caster_of, off_surface
from renderers.transport.sampling import generator, lattice
from renderers.transport.seen import seen_along
from renderers.transport.threads import chunks, in_threads

F64 = NDArray[np.float64]
RAYS_PER_TASK = 1 << 15


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
    receivers = receivers_of(world, gbuffer, rows)
    view = gbuffer.eye - receivers.position
    view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
    lobes = lobes_alone(materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows]))
    shifts, points = generator(seed, "lobes").random((len(rows), 9)), lattice(rays, 9)

    def task(part: slice) -> tuple[F64, int]:
        here = Receivers(*(column[part] for column in receivers))
        numbers = (points[None] + shifts[part, None]) % 1.0
        return _traced(world, here, view[part], lobes.rows(part), numbers, incoming)

    done = in_threads(task, chunks(len(rows), max(1, RAYS_PER_TASK // rays)))
    if counters is not None:
        counters["lobe_rays"] += sum(cast for _, cast in done)
    return np.concatenate([light for light, _ in done]) if done else np.zeros((0, 3))


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


def _traced(world: World, receivers: Receivers, view: F64, lobes: Materials, numbers: F64, incoming: Incoming) -> tuple[F64, int]:
    """Radiance (P, 3) of numbers (P, rays, 9), and the rays cast for it."""
    count, rays = numbers.shape[:2]
    pixel = np.repeat(np.arange(count), rays)
    flat = numbers.reshape(-1, 9)
    m, n, v = lobes.rows(pixel), receivers.normal[pixel], view[pixel]
    direction = sample_brdf(m, n, v, flat[:, :3])
    pdf = sampling_pdf(m, n, v, direction)
    cosine = np.einsum("ij,ij->i", n, direction)
    live = np.flatnonzero((cosine > 0) & (pdf > 0))
    brought = evaluate(m.rows(live), n[live], direction[live], v[live]) * (cosine[live] / pdf[live])[:, None]
    origin = off_surface(receivers.position[pixel[live]], receivers.geometric[pixel[live]], direction[live])
    aim = direction[live].astype(np.float32)
    seen = seen_along(world, aim, caster_of(world).first_hit(origin, aim))
    radiance, shadow_rays = incoming(seen, flat[live[seen.ray], 3:])
    light = np.zeros((count, 3))
    np.add.at(light, pixel[live[seen.ray]], brought[seen.ray] * radiance)
    return light / rays, len(live) + shadow_rays
