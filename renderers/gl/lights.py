"""A World's light as a deterministic list of point-like samples, each of which can have a shadow map.

Point, spot and directional lights are one sample each. Emitting triangles and the environment are k samples each, spread by
importance: strata of equal power over (triangle, side), placed inside a triangle by its van der Corput points (Basu & Owen
2015), or strata of equal radiance × solid angle over the sphere, placed inside a texel by the R2 sequence. Sums over samples
approach the integral as k grows; there is no random number, so the same World gives the same samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from renderers.images import luminance
from renderers.scene.environment import radiance
from renderers.scene.model import Environment
from renderers.scene.world import F64, World, rotation_matrix

# Distance from an emitter's plane at which its samples lie: clear of float32 rounding (1e-7), far under any shadow texel.
LIFT = 2e-5
R2 = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, eq=False)
class LightSample:
    """One point-like light.

    position (3,); axis (3,): unit, the way light travels (area: the emitting side's normal). cosines: spot's inner and outer.
    intensity (3,): W/sr × scale², an area sample's to be multiplied by the cosine at its side; directional: W/m².
    """

    kind: Literal["point", "spot", "directional", "area"]
    position: F64
    axis: F64
    intensity: F64
    cosines: tuple[float, float] = (1.0, 0.0)


def light_samples(world: World, count: int) -> list[LightSample]:
    """All light of the World.

    `count` samples for all emitting triangles together and as many for the environment, none where there is none.
    """
    samples = [
        LightSample(light.kind, light.position, light.direction, light.intensity, (light.cos_inner, light.cos_outer))  # type: ignore[arg-type]
        for light in world.lights
        if light.intensity.any()
    ]
    if len(world.emissive):
        samples += _area_samples(world, count)
    if world.environment is not None and any(world.environment.radiance):
        samples += _environment_samples(world.environment, count)
    return samples


def _area_samples(world: World, count: int) -> list[LightSample]:
    """p(y) = share of power / area; intensity = L / (p(y) · count)."""
    emissive = world.emissive
    both = emissive[world.materials.emits_both[world.material[emissive]]]
    triangles = np.concatenate([emissive, both])
    sides = np.concatenate([np.ones(len(emissive)), -np.ones(len(both))])
    radiance = world.materials.emission[world.material[triangles]].astype(np.float64)
    area = world.areas_of(triangles)
    power = luminance(radiance) * area
    chosen, rest = _strata(power, count)
    weight = area[chosen] * power.sum() / (power[chosen] * count)
    points = _triangle_points(world.positions[world.triangles[triangles[chosen]]].astype(np.float64), rest)
    normals = world.normals_of(triangles[chosen]) * sides[chosen, None]
    return [
        LightSample("area", y + LIFT * n, n, i)
        for y, n, i in zip(points, normals, radiance[chosen] * weight[:, None], strict=True)
    ]  # fmt: skip


def _environment_samples(environment: Environment, count: int) -> list[LightSample]:
    """Directional samples of irradiance L(ω) / (p(ω) · count)."""
    u = _r2(count)
    if environment.image is None:
        local, weight = _sphere(u), np.full(count, 4 * np.pi / count)
    else:
        local, weight = _texel_directions(environment.image, u)
    towards = local @ rotation_matrix(environment.rotation).T
    irradiance = radiance(environment, towards) * weight[:, None]
    return [LightSample("directional", np.zeros(3), -d, e) for d, e in zip(towards, irradiance, strict=True) if e.any()]


def _texel_directions(image: NDArray[np.float32], u: F64) -> tuple[F64, F64]:
    """Directions by the luminance of the cells between rows and around columns, and 1 / (p · count).

    A cell is chosen by its largest corner, so that wherever the bilinear look-up is above zero p is too.
    """
    lum = luminance(image)
    height, width = lum.shape
    wide = np.maximum(np.maximum(lum, np.roll(lum, 1, axis=1)), np.roll(lum, -1, axis=1))
    cells = np.maximum(wide[:-1], wide[1:]) if height > 1 else wide
    edges = np.cos(np.pi * np.arange(len(cells) + 1) / len(cells))
    share = cells * (edges[:-1] - edges[1:])[:, None]
    count = len(u)
    chosen, _ = _strata(share.ravel(), count)
    j, i = np.divmod(chosen, width)
    cosine = edges[j] + u[:, 0] * (edges[j + 1] - edges[j])
    azimuth = (i + u[:, 1]) / width * 2 * np.pi
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    directions = np.stack([sine * np.sin(azimuth), cosine, -sine * np.cos(azimuth)], axis=1)
    solid = (edges[j] - edges[j + 1]) * 2 * np.pi / width
    return directions, solid * share.sum() / (share.ravel()[chosen] * count)


def _strata(weight: F64, count: int) -> tuple[NDArray[np.intp], F64]:
    """Index into `weight` at the middle of each of `count` equal parts of its sum, and where in that entry, in [0, 1).

    Both (count,).
    """
    total = np.cumsum(weight)
    place = (np.arange(count) + 0.5) / count * total[-1]
    index = np.minimum(np.searchsorted(total, place, side="right"), len(weight) - 1)
    rest = (place - (total[index] - weight[index])) / weight[index]
    return index, np.clip(rest, 0.0, 1.0 - 1e-12)


def _r2(count: int) -> F64:
    """First points of the R2 sequence (Roberts 2018), (count, 2) in [0, 1)."""
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * R2) % 1.0)


def _triangle_points(corners: F64, rest: F64) -> F64:
    """Points (N, 3) in triangles (N, 3, 3): each base-4 digit of `rest` (N,) picks one of four quarters, 0 the middle one."""
    for _ in range(8):
        digit = np.floor(rest * 4).astype(int)
        rest = rest * 4 - digit
        middles = (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1)) / 2
        # quarter k keeps corner k - 1 and moves the others half way to it
        kept = corners[np.arange(len(corners)), np.maximum(digit - 1, 0)][:, None]
        corners = np.where((digit == 0)[:, None, None], middles, (corners + kept) / 2)
    return np.asarray(corners.mean(axis=1))


def _sphere(u: F64) -> F64:
    """Uniform unit directions (N, 3) from u (N, 2)."""
    y, azimuth = 1 - 2 * u[:, 0], 2 * np.pi * u[:, 1]
    sine = np.sqrt(np.maximum(1 - y**2, 0))
    return np.stack([sine * np.cos(azimuth), y, sine * np.sin(azimuth)], axis=1)
