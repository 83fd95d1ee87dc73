"""Direct light with a hidden share per area light: C = Σ_e C_e (1 - V_e), C_e the light of emitter e without shadows.

The separation is the source's (St-Amour 2004 §4.1): V weighs all parts of a light alike, where the truth weighs them with the
cosines and the distance. Parts behind the receiver's plane weigh nothing in C_e, and are taken out of V as well: exactly that
share, which needs a V that contains all of it, or by shadow rays to the points before the plane. Points that no map covers get V
from shadow rays to the same light points; punctual lights, the environment, and area lights beyond those asked for are ray cast
altogether.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import MaterialTable, World
from renderers.transport.direct import Receivers, direct, emitted, receivers_of
from renderers.transport.penumbra.emitters import Emitter
from renderers.transport.raycast import OFFSET, RayCaster, caster_of, off_surface
from renderers.transport.threads import chunks

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
# hidden(k, positions, normals) is the share of emitter k hidden from surface points (P, 3), float (P,), -1 where it can't tell
Hidden = Callable[[int, F64, F64], F32]
# light behind the receiver's plane: shadow rays to what is before it, V less its share, or nothing is done about it
Horizon = Literal["rays", "share", "ignored"]
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
    horizon: Horizon = "rays",
) -> F32:
    """Emission, background and direct light, float32 (H, W, 3).

    points: light points (N, 3) of each emitter, for shadow rays where `hidden` answers -1. light_samples: per pixel, for the light
    without shadows and for what is ray cast. horizon: as in `before_plane`. counters: adds `rays`, `points_ray_cast` and, of these,
    `points_at_horizon`.
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
        whole = hidden(k, receivers.position, _towards(receivers.geometric, receivers.normal))
        share = before_plane(world, emitter, points[k], receivers, whole, horizon, counters)
        flat[rows] += free[rows] * (1 - share)[:, None]
    return image


def before_plane(
    world: World, emitter: Emitter, points: F64, receivers: Receivers, share: ArrayLike, horizon: Horizon, counters: Counter[str]
) -> F64:
    """Hidden share (P,) of the light points (N, 3) that are before the receivers' planes, from the share (P,) of all of them.

    horizon: `rays` casts shadow rays where some points are behind the plane and neither none nor all are hidden; `share` takes
    them out of the share; `ignored`: the share doesn't count them. A share of -1 is ray cast in any case. counters: adds `rays`,
    `points_ray_cast` and `points_at_horizon`.
    """
    out = np.array(share, np.float64)
    missing = out < 0
    behind = np.zeros(len(out))
    if horizon != "ignored":
        count_behind(receivers.position, receivers.normal, points, points.mean(axis=0), behind)
    cast = missing
    if horizon == "rays":
        cast = missing | ((behind > 0) & (out > 0) & (out < 1))
    out = without_behind(out, behind, len(points))
    rows = np.flatnonzero(cast)
    out[rows] = cast_before(world, emitter, points, Receivers(*(column[rows] for column in receivers)), counters)
    counters["points_ray_cast"] += len(rows)
    counters["points_at_horizon"] += len(rows) - int(np.count_nonzero(missing))
    return out


def without_behind(share: F64, behind: F64, count: int) -> F64:
    """Hidden share (P,) of those of `count` light points that are before the receivers' planes, from the share of all of them.

    Light from behind the plane is missing in the light without shadows already, and always hidden: by the surface itself. With H
    the share behind the plane, (V - H) / (1 - H) counts it once.
    """
    return np.asarray(np.clip((share - behind) / np.maximum(1 - behind, 0.5 / count), 0, 1))


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
    """Share of the light points (N, 3) that shadow rays from surface points (P, 3) with geometric normals don't reach, (P,).

    Rays leave to the side of the surface that their light point is on.
    """
    blocked, total = _cast(world, emitter, points, Receivers(positions, geometric, geometric), counters, all_sides=True)
    return blocked / np.maximum(total, 1)


def cast_before(world: World, emitter: Emitter, points: F64, receivers: Receivers, counters: Counter[str]) -> F64:
    """The same (P,) of those light points (N, 3) that are before the receivers' planes; 0 where none is."""
    blocked, total = _cast(world, emitter, points, receivers, counters, all_sides=False)
    return blocked / np.maximum(total, 1)


def _cast(
    world: World, emitter: Emitter, points: F64, receivers: Receivers, counters: Counter[str], *, all_sides: bool
) -> tuple[F64, F64]:
    """Blocked shadow rays and all of them, (P,) each."""
    count = len(receivers.position)
    blocked, total = np.zeros(count), np.zeros(count)
    if not count:
        return blocked, total
    caster = caster_without(world, emitter)
    for part in chunks(count, max(RAYS // len(points), 1)):
        here = Receivers(*(column[part] for column in receivers))
        towards = points[None] - here.position[:, None]
        aimed = np.ones(towards.shape[:2], bool) if all_sides else np.einsum("pni,pi->pn", towards, here.normal) > 0
        row, which = np.nonzero(aimed)
        start = off_surface(here.position[row], here.geometric[row], towards[row, which])
        hit = caster.occluded(start, points[which] - start, 1 - OFFSET)
        blocked[part] = np.bincount(row, weights=hit, minlength=len(here.position))
        total[part] = aimed.sum(axis=1)
        counters["rays"] += len(row)
    return blocked, total


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
