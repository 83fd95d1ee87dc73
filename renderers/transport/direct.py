"""Direct light with exact, ray-cast visibility at pixels and at any other surface points.

Matches Mitsuba's `path` with max_depth=2 less the emission seen directly: punctual lights, emissive triangles (their front, or
both sides with `emits_both`), constant and lat-long environments.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.environment import radiance
from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import Materials, evaluate, materials_at
from renderers.transport.incident import Incident, Lights
from renderers.transport.raycast import FAR, OFFSET, RayCaster, caster_of, off_surface
from renderers.transport.sampling import generator
from renderers.transport.threads import chunks, in_threads

F64 = NDArray[np.float64]
Visibility = Literal["raycast", "none"]
CHUNK = 1 << 14


class Receivers(NamedTuple):
    """Surface points that receive light: position, normal (shading, turned to the viewer), geometric: float64 (N, 3)."""

    position: F64
    normal: F64
    geometric: F64


def direct(
    world: World,
    gbuffer: GBuffer,
    light_samples: int = 16,
    seed: int = 0,
    visibility: Visibility = "raycast",
    counters: Counter[str] | None = None,
) -> NDArray[np.float32]:
    """Reflected direct light of each pixel, float32 (H, W, 3); emission and background not added.

    light_samples: per pixel, on area lights and on the environment each. counters: `rays` is added to.
    """
    rows = np.flatnonzero(gbuffer.covered)
    receivers = receivers_of(world, gbuffer, rows)
    view = gbuffer.eye - receivers.position
    view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
    materials = materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows])
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[rows] = _gathered(world, receivers, view, materials, light_samples, seed, "direct", visibility, counters)
    return image.reshape(*gbuffer.triangle.shape, 3)


def irradiance(
    world: World,
    position: F64,
    normal: F64,
    geometric: F64,
    light_samples: int = 16,
    seed: int = 0,
    visibility: Visibility = "raycast",
    counters: Counter[str] | None = None,
    shifts: F64 | None = None,
) -> F64:
    """Direct irradiance on the side that `normal` (shading, unit) points to, float64 (N, 3); position, normal, geometric (N, 3).

    shifts (N, 6) in [0, 1): move each receiver's light samples; drawn by row from `seed` where they aren't given.
    """
    return _gathered(
        world, Receivers(position, normal, geometric), None, None, light_samples, seed, "irradiance", visibility, counters, shifts
    )


def receivers_of(world: World, gbuffer: GBuffer, rows: NDArray[np.intp]) -> Receivers:
    """Receivers of flat pixel indices (N,) that see a surface."""
    position = gbuffer.position.reshape(-1, 3)[rows].astype(np.float64)
    normal = gbuffer.normal.reshape(-1, 3)[rows].astype(np.float64)
    return Receivers(position, normal, world.normals_of(gbuffer.triangle.ravel()[rows]))


def emitted(world: World, gbuffer: GBuffer) -> NDArray[np.float32]:
    """Radiance that pixels see without any bounce: emission of surfaces, environment on the background; float32 (H, W, 3)."""
    image = gbuffer.emission.astype(np.float64)
    if world.environment is not None:
        _, directions = world.camera.rays(gbuffer.size, gbuffer.offset)
        background = ~gbuffer.covered
        image[background] = radiance(world.environment, directions[background])
    return image.astype(np.float32)


def _gathered(
    world: World,
    receivers: Receivers,
    view: F64 | None,
    materials: Materials | None,
    samples: int,
    seed: int,
    stream: str,
    visibility: Visibility,
    counters: Counter[str] | None,
    shifts: F64 | None = None,
) -> F64:
    count = len(receivers.position)
    lights = Lights(world, samples)
    if shifts is None:
        shifts = generator(seed, stream).random((count, 6)) if lights.stochastic else np.zeros((count, 6))
    caster = caster_of(world) if visibility == "raycast" else None

    def chunk(part: slice) -> tuple[F64, int]:
        here = Receivers(*(column[part] for column in receivers))
        total, rays = np.zeros_like(here.position), 0
        for sample in lights.incident(here.position, here.normal, shifts[part]):
            brought, cast = _received(here, sample, caster)
            rays += cast
            if materials is not None and view is not None:
                brought *= _brdf(materials.rows(part), here.normal, sample.direction, view[part])
            total += brought
        return total, rays

    parts = in_threads(chunk, chunks(count, CHUNK))
    if counters is not None:
        counters["rays"] += sum(rays for _, rays in parts)
    return np.concatenate([total for total, _ in parts]) if parts else np.zeros((0, 3))


def _received(receivers: Receivers, sample: Incident, caster: RayCaster | None) -> tuple[F64, int]:
    """Irradiance (N, 3) brought by one sample, and the number of rays cast."""
    cosine = np.einsum("ij,ij->i", receivers.normal, sample.direction)
    reached = (cosine > 0) & sample.weight.any(axis=1)
    rays = 0
    if caster is not None:
        rows = np.flatnonzero(reached)
        rays = len(rows)
        reached[rows[_shadowed(receivers.position[rows], receivers.geometric[rows], sample, rows, caster)]] = False
    return np.where(reached[:, None], sample.weight * cosine[:, None], 0.0), rays


def _shadowed(position: F64, geometric: F64, sample: Incident, rows: NDArray[np.intp], caster: RayCaster) -> NDArray[np.bool_]:
    """Whether the way to the light is blocked; aimed anew from the moved origin, so that it ends at the light, not behind it."""
    direction, distance = sample.direction[rows], sample.distance[rows]
    origin = off_surface(position, geometric, direction)
    distant = np.isinf(distance)
    aim = np.where(distant[:, None], direction, position + direction * np.where(distant, 0, distance)[:, None] - origin)
    reach = np.where(distant, FAR, 1 - OFFSET)
    return caster.occluded_unthreaded(origin.astype(np.float32), aim.astype(np.float32), reach.astype(np.float32))


def _brdf(materials: Materials, normal: F64, light: F64, view: F64) -> F64:
    if (materials.kind == LAMBERT).all():
        return np.asarray(materials.base / np.pi)
    return evaluate(materials, normal, light, view)
