"""Virtual point lights of one bounce (Keller 1997): area-uniform surface points that re-emit the direct light they receive.

    I = ρ/π · E · |S| / N        E direct irradiance, shadowed; density of the points 1/|S|

The points are drawn by area over the whole scene, or come from `resampling`, one of each η* of surface; then |S| / N is η*.

Surfaces are two-sided, so a point may become two VPLs, one for each lit side; each emits as a Lambertian into the hemisphere of the
geometric normal of its side, and receives with the shading normal turned to that side. Glossy surfaces re-emit as diffuse ones of
their mean albedo. Emission is direct light and makes no VPL.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import materials_at, mean_albedo
from renderers.transport.direct import irradiance
from renderers.transport.resampling.points import Points
from renderers.transport.sampling import Sampler, SurfacePoints, surface_points
from renderers.transport.surface import surface_at, turned


@dataclass(frozen=True, eq=False)
class Vpls:
    """Lit VPLs in World units: positions, normals (geometric, of the lit side), intensities: float32 (L, 3); index int64 (L,).

    `index` is the number of the drawn point, 0 … drawn-1; points without light on a side leave no VPL there but count in `drawn`.
    numbers (L, 2): two uniform numbers that belong to the point, for its level and its sub-image; None: they go by `index`.
    """

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    intensities: NDArray[np.float32]
    index: NDArray[np.int64]
    drawn: int
    numbers: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.positions)


def emit_vpls(
    world: World,
    count: int,
    seed: int = 0,
    sampler: Sampler = "uniform",
    light_samples: int = 16,
    counters: Counter[str] | None = None,
) -> Vpls:
    """VPLs of `count` points. counters: `vpls_drawn`, `vpls_lit` and `rays` are added to."""
    points = surface_points(world, count, seed, sampler)
    return emit_at(world, points, np.full(count, world.areas.sum() / count), seed, light_samples, counters)


def emit_at(
    world: World,
    points: SurfacePoints,
    share: NDArray[np.float64],
    seed: int = 0,
    light_samples: int = 16,
    counters: Counter[str] | None = None,
) -> Vpls:
    """VPLs of given points, each of which stands for `share` of the surface, World units² (N,)."""
    return _lit(world, points, share, None, None, light_samples, seed, counters)


def emit_resampled(
    world: World, points: Points, area: float, light_samples: int = 16, seed: int = 0, counters: Counter[str] | None = None
) -> Vpls:
    """VPLs of points drawn one for each `area` (World units²). Their light samples go with the points too, so nothing flickers."""
    spare = points.further(7)
    numbers = np.stack([points.level_number, spare[:, 0]], axis=1)
    where = SurfacePoints(points.triangle, points.u.astype(np.float64), points.v.astype(np.float64))
    return _lit(world, where, area * points.weight.astype(np.float64), numbers, spare[:, 1:], light_samples, seed, counters)


def _lit(
    world: World,
    points: SurfacePoints,
    share: NDArray[np.float64],
    numbers: NDArray[np.float64] | None,
    shifts: NDArray[np.float64] | None,
    light_samples: int,
    seed: int,
    counters: Counter[str] | None,
) -> Vpls:
    """Light of points that stand for `share` of the surface each, World units² (N,)."""
    surface, count = surface_at(world, *points), len(share)
    albedo = surface.base
    if (world.materials.kind[surface.material] != LAMBERT).any():
        albedo = mean_albedo(materials_at(world.materials, surface.material, surface.base))
    sides = np.concatenate([surface.geometric, -surface.geometric])
    twice = np.tile(np.arange(count), 2)
    bright = albedo[twice].any(axis=1)
    sides, twice = sides[bright], twice[bright]
    position, normal = surface.position[twice], turned(surface.normal[twice], sides)
    own = None if shifts is None else shifts[twice]
    light = irradiance(world, position, normal, sides, light_samples, seed, counters=counters, shifts=own)
    intensity = (albedo[twice] / np.pi * light * share[twice, None]).astype(np.float32)
    lit = intensity.any(axis=1)
    if counters is not None:
        counters["vpls_drawn"] += count
        counters["vpls_lit"] += int(lit.sum())
    kept = None if numbers is None else numbers[twice[lit]]
    return Vpls(position[lit].astype(np.float32), sides[lit].astype(np.float32), intensity[lit], twice[lit], count, kept)
