"""Indirect light of a view from a cache made of photons: irradiance splatted on diffuse pixels, radiance records on glossy ones.

Pixels that no record reaches get zones of their own if asked; glossy lobes that no order of harmonics holds are traced.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.caching.glossy import reflected
from renderers.transport.caching.records import Records
from renderers.transport.caching.reflectance import Gloss, Lobes, stand_in_albedo
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.traced import traced_lobes
from renderers.transport.photons.density import Points, points
from renderers.transport.photons.glossy import ReflectedPhotonLight, radiance_of_zones
from renderers.transport.photons.map import PhotonMap
from renderers.transport.photons.walk import Cache
from renderers.transport.photons.zones import OFF, Recipe, Zones, zones_of
from renderers.transport.threads import chunks

F64 = NDArray[np.float64]
PIXELS = 1 << 12  # whose coefficients are held at once


class Built(NamedTuple):
    """All that any view of a World shares. radiance: records with coefficients, None where `gloss` needs none; gloss: None where
    glossy surfaces count as diffuse ones of the same mean albedo."""

    world: World
    photons: PhotonMap
    cache: Cache
    recipe: Recipe
    gloss: Gloss | None
    radiance: Records | None


class Viewing(NamedTuple):
    """splatted: from records, else each pixel from a zone of its own; filled: pixels that no record reaches get one.

    glossy_a: accuracy of radiance records. lobe_rays: rays a pixel of traced lobes.
    """

    splatted: bool
    filled: bool
    glossy_a: float
    lobe_rays: int


def indirect_light(built: Built, how: Viewing, gbuffer: GBuffer, seed: int, counters: Counter[str]) -> F64:
    """Radiance float64 (H, W, 3) of a view.

    counters: `splats`, `splat_tests`, `glossy_splats`, `pixels_missed`, `pixels_without_photons`, `pixels_traced`, `lobe_rays`.
    """
    world, gloss = built.world, built.gloss
    albedo = stand_in_albedo(world, gbuffer) if gloss is None else gloss.diffuse(world, gbuffer)
    canvas = Canvas.of(gbuffer, albedo.max(axis=2) > 0)
    image = np.zeros((gbuffer.triangle.size, 3))
    image[canvas.rows] = _irradiance(built, how, gbuffer, canvas, counters) * albedo.reshape(-1, 3)[canvas.rows] / np.pi
    if gloss is not None:
        if built.radiance is not None:
            glossy = Canvas.of(gbuffer, gloss.cached(gbuffer))
            image[glossy.rows] = _reflected(built, how, gbuffer, glossy, counters)
        rows = np.flatnonzero(gloss.traced(gbuffer))
        if len(rows):
            incoming = ReflectedPhotonLight(world, built.cache.records)
            image[rows] += traced_lobes(world, gbuffer, rows, how.lobe_rays, incoming, seed, counters)
            counters["pixels_traced"] += len(rows)
    return image.reshape(*gbuffer.triangle.shape, 3)


def _irradiance(built: Built, how: Viewing, gbuffer: GBuffer, canvas: Canvas, counters: Counter[str]) -> F64:
    """Irradiance (P, 3) of a canvas's pixels."""
    if how.splatted:
        gradients = built.recipe.gradients != OFF
        canvas.add(built.cache.records, built.recipe.a, gradients=gradients, counters=counters)
        found, missed = canvas.irradiance.astype(np.float64), canvas.missed
    else:
        found, missed = np.zeros((len(canvas), 3)), np.ones(len(canvas), bool)
    counters["pixels_missed"] += int(np.count_nonzero(missed))
    if how.filled and missed.any():
        found[missed] = _own_zones(built, gbuffer, canvas.rows[missed], counters)[1].irradiance
    return found


def _reflected(built: Built, how: Viewing, gbuffer: GBuffer, canvas: Canvas, counters: Counter[str]) -> F64:
    """Radiance (P, 3) that glossy pixels reflect."""
    assert built.gloss is not None  # what `Built` promises
    assert built.radiance is not None
    lobes = Lobes(built.world, gbuffer, canvas.rows, built.gloss)
    if how.splatted:
        canvas.add(built.radiance, how.glossy_a, gradients=False)
        found = reflected(canvas, built.radiance, lobes, how.glossy_a, gradients=False, counters=counters)
        missed = np.flatnonzero(canvas.missed)
    else:
        found, missed = np.zeros((len(canvas), 3)), np.arange(len(canvas))
    counters["pixels_missed"] += len(missed)
    if how.filled:
        for part in chunks(len(missed), PIXELS):
            pixels = missed[part]
            where, zones = _own_zones(built, gbuffer, canvas.rows[pixels], counters)
            own = np.full(len(pixels), -1, np.int64)
            light = radiance_of_zones(built.photons, where, own, zones, built.gloss.order)
            weight = Lobes(built.world, gbuffer, canvas.rows[pixels], built.gloss)(slice(None))
            found[pixels] = np.maximum(np.einsum("pci,pic->pc", weight, light), 0)
    return found


def _own_zones(built: Built, gbuffer: GBuffer, rows: NDArray[np.intp], counters: Counter[str]) -> tuple[Points, Zones]:
    """Zones of pixels (flat indices), which grow up to a · r_max; their irradiance is 0 where those hold no photon."""
    position, normal = gbuffer.position.reshape(-1, 3)[rows], gbuffer.normal.reshape(-1, 3)[rows]
    where = points(built.world, position, normal, gbuffer.triangle.ravel()[rows])
    zones = zones_of(built.photons, where, np.full(len(rows), -1, np.int64), built.recipe)
    counters["pixels_without_photons"] += int(np.count_nonzero(zones.photons == 0))
    return where, zones
