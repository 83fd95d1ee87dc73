"""Direct light with a hidden share per area light: C = Σ_e C_e (1 - V_e), C_e the light of emitter e without shadows.

The separation is the source's (St-Amour 2004 §4.1): V weighs all parts of a light alike, where the truth weighs them with the
cosines and the distance. Parts behind the receiver's plane weigh nothing in C_e, and are taken out of V as well. Points that no map
covers get V from shadow rays to the same light points; punctual lights, the environment, and area lights beyond those asked for are
ray cast altogether.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import MaterialTable, World
from renderers.transport.direct import direct, emitted, receivers_of
from renderers.transport.penumbra.emitters import Emitter
from renderers.transport.raycast import OFFSET, RayCaster, caster_of, off_surface
from renderers.transport.threads import chunks

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
# hidden(k, positions, normals) is the share of emitter k hidden from surface points (P, 3), float (P,), -1 where it can't tell
Hidden = Callable[[int, F64, F64], F32]
RAYS = 1 << 18


def shaded(
    world: World,
    gbuffer: GBuffer,
    emitters: Sequence[Emitter],
    points: Sequence[F64],
    hidden: Hidden,
    light_samples: int,
    seed: int,
    counters: Counter[str],
    *,
    horizon: bool = True,
) -> F32:
    """Emission, background and direct light, float32 (H, W, 3).

    points: light points (N, 3) of each emitter, for shadow rays where `hidden` answers -1. light_samples: per pixel, for the light
    without shadows and for what is ray cast. horizon: `hidden` counts light points behind the receiver's plane, too. counters: adds
    `rays` and `points_ray_cast`.
    """
    image = emitted(world, gbuffer)
    handled = np.concatenate([e.triangles for e in emitters]) if emitters else np.zeros(0, np.int64)
    rest = shining(world, np.setdiff1d(world.emissive, handled), others=True)
    if len(rest.emissive) or rest.lights or rest.environment is not None:
        image += direct(rest, gbuffer, light_samples, seed, counters=counters)
    flat = image.reshape(-1, 3)
    for k, emitter in enumerate(emitters):
        free = direct(shining(world, emitter.triangles), gbuffer, light_samples, seed, "none").reshape(-1, 3)
        rows = np.flatnonzero(free.any(axis=1))
        receivers = receivers_of(world, gbuffer, rows)
        share = np.array(hidden(k, receivers.position, _towards(receivers.geometric, receivers.normal)), np.float64)
        missing = np.flatnonzero(share < 0)
        share[missing] = cast_hidden(world, emitter, points[k], receivers.position[missing], receivers.geometric[missing], counters)
        cast = slice(None) if horizon else missing
        share[cast] = before_horizon(share[cast], receivers.position[cast], receivers.normal[cast], points[k])
        flat[rows] += free[rows] * (1 - share)[:, None]
        counters["points_ray_cast"] += len(missing)
    return image


def before_horizon(share: F64, positions: F64, normals: F64, points: F64) -> F64:
    """Hidden share (P,) of those light points (N, 3) that are before the receivers' planes, from the share of all of them.

    Light from behind the plane is missing in the light without shadows already, and always hidden: by the surface itself. With H
    the share behind the plane, (V - H) / (1 - H) counts it once.
    """
    behind = np.zeros(len(share))
    count_behind(positions, normals, points, points.mean(axis=0), behind)
    return np.asarray(np.clip((share - behind) / np.maximum(1 - behind, 0.5 / len(points)), 0, 1))


@numba.njit(parallel=True, cache=True)
def count_behind(positions, normals, points, centre, behind):  # type: ignore[no-untyped-def]
    """behind (P,): share of points (N, 3) behind the planes through positions (P, 3) with normals (P, 3)."""
    radius = 0.0
    for point in points:
        d = point - centre
        radius = max(radius, np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]))
    for i in numba.prange(len(positions)):
        p, n = positions[i], normals[i]
        height = n[0] * (centre[0] - p[0]) + n[1] * (centre[1] - p[1]) + n[2] * (centre[2] - p[2])
        if height >= radius:
            continue
        count = 0
        for k in range(len(points)):
            count += n[0] * (points[k, 0] - p[0]) + n[1] * (points[k, 1] - p[1]) + n[2] * (points[k, 2] - p[2]) <= 0
        behind[i] = count / len(points)


def cast_hidden(world: World, emitter: Emitter, points: F64, positions: F64, geometric: F64, counters: Counter[str]) -> F64:
    """Share of the light points (N, 3) that shadow rays from surface points (P, 3) with geometric normals don't reach, (P,)."""
    out = np.zeros(len(positions))
    if not len(positions):
        return out
    caster = caster_without(world, emitter)
    for part in chunks(len(positions), max(RAYS // len(points), 1)):
        p, n = (np.repeat(a[part], len(points), axis=0) for a in (positions, geometric))
        target = np.tile(points, (len(p) // len(points), 1))
        start = off_surface(p, n, target - p)
        blocked = caster.occluded(start, target - start, 1 - OFFSET)
        out[part] = blocked.reshape(-1, len(points)).mean(axis=1)
        counters["rays"] += len(p)
    return out


def caster_without(world: World, emitter: Emitter) -> RayCaster:
    """Caster of the World where a light's own surface can't hide its points: left out unless it is flat."""
    if emitter.kind not in ("sphere", "mesh"):
        return caster_of(world)
    keep = np.ones(len(world.triangles), bool)
    keep[emitter.triangles] = False
    return RayCaster(replace(world, triangles=world.triangles[keep], material=world.material[keep], instance=world.instance[keep]))


def shining(world: World, triangles: NDArray[np.integer], *, others: bool = False) -> World:
    """The same World where only these emissive triangles emit; `others` keeps punctual lights and environment as well."""
    dark = np.setdiff1d(world.emissive, triangles)
    table = world.materials
    black = MaterialTable(*(np.concatenate([a, a]) for a in vars(table).values()))
    black.emission[len(table.kind) :] = 0
    material = world.material.copy()
    material[dark] += len(table.kind)
    if others:
        return replace(world, materials=black, material=material)
    return replace(world, materials=black, material=material, lights=(), environment=None)


def _towards(geometric: F64, normal: F64) -> F64:
    """Geometric normals on the side of the shading normals."""
    away = np.einsum("ij,ij->i", geometric, normal) < 0
    return np.where(away[:, None], -geometric, geometric)
