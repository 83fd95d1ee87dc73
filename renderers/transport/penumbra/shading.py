"""Direct light with a hidden share per area light: C = Σ_e C_e (1 - V_e), C_e the light of emitter e without shadows.

The separation is the source's (St-Amour 2004 §4.1): V weighs all parts of a light alike, where the truth weighs them with the
cosines and the distance. Points that no map covers get V from shadow rays to the same light points; punctual lights, the
environment, and area lights beyond those asked for are ray cast altogether.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

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
) -> F32:
    """Emission, background and direct light, float32 (H, W, 3).

    points: light points (N, 3) of each emitter, for shadow rays where `hidden` answers -1. light_samples: per pixel, for the light
    without shadows and for what is ray cast. counters: adds `rays` and `points_ray_cast`.
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
        flat[rows] += free[rows] * (1 - share)[:, None]
        counters["points_ray_cast"] += len(missing)
    return image


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
