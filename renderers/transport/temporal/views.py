"""Pixels of the views of a frame, by what gives their indirect light: irradiance, radiance records, or rays of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.caching.glossy import reflected
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.placement import Placement
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.reflectance import Gloss, Lobes, stand_in_albedo
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.traced import Price, few_at, traced_alone, traced_lobes
from renderers.transport.direct import direct, emitted, receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal.cache import View

F64 = NDArray[np.float64]
DIFFUSE, GLOSSY = "diffuse", "glossy"


class Look(NamedTuple):
    """Pixels of a view. albedo (P, 3), where they are diffuse; lobes, where they are glossy."""

    view: View
    albedo: F64 | None
    lobes: Lobes | None

    def light(self, records: Records, how: Placement, counters: Counter[str]) -> F64:
        """What they reflect of records, (P, 3). Irradiance is splatted on the view's canvas, in place of what it held."""
        canvas = self.view.canvas
        if self.lobes is not None:
            return reflected(canvas, records, self.lobes, how.a, how.weight, how.gradients, counters)
        canvas.clear()
        canvas.add(records, how.a, how.weight, how.gradients, counters)
        return self.reflected

    @property
    def reflected(self) -> F64:
        """What diffuse pixels reflect of the irradiance that is on their canvas, (P, 3)."""
        assert self.albedo is not None
        return np.asarray(self.view.canvas.irradiance * self.albedo / np.pi)


def looks_of(world: World, gbuffer: GBuffer, gloss: Gloss | None, price: Price) -> dict[str, Look]:
    """Diffuse and glossy pixels of a view; gloss: None where glossy surfaces count as diffuse ones of the same mean albedo; price:
    of radiance records."""
    albedo = stand_in_albedo(world, gbuffer) if gloss is None else gloss.diffuse(world, gbuffer)
    canvas = Canvas.of(gbuffer, albedo.max(axis=2) > 0)
    found = {DIFFUSE: Look(_view(world, gbuffer, canvas), albedo.reshape(-1, 3)[canvas.rows], None)}
    if gloss is not None:
        canvas = Canvas.of(gbuffer, gloss.cached(gbuffer))
        canvas.few = few_at(gloss, gbuffer, canvas.rows, price)
        found[GLOSSY] = Look(_view(world, gbuffer, canvas), None, Lobes(world, gbuffer, canvas.rows, gloss))
    return found


class Traced(NamedTuple):
    """Light (P, 3) of pixels (flat indices) of a view that no record holds."""

    rows: NDArray[np.intp]
    light: F64


def gbuffers_of(world: World, size: tuple[int, int], subpixels: int) -> list[GBuffer]:
    """What the camera sees through each of k × k sub-pixels."""
    k = subpixels
    return [cast_gbuffer(world, size, ((index % k + 0.5) / k, (index // k + 0.5) / k)) for index in range(k * k)]


def direct_of(world: World, gbuffers: Sequence[GBuffer], samples: int, seed: int, counters: Counter[str]) -> F64:
    """Direct light (H, W, 3) of all views, summed; counters: `pixels_covered` is added to."""
    total = np.zeros((*gbuffers[0].triangle.shape, 3))
    for index, gbuffer in enumerate(gbuffers):
        total += emitted(world, gbuffer) + direct(world, gbuffer, samples, seed + (index << 32), counters=counters)
        counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
    return total


def traced_of(
    world: World, gbuffers: Sequence[GBuffer], gloss: Gloss | None, rays: int, seed: int, counters: Counter[str]
) -> list[Traced]:
    """Lobes of each view that no record holds, traced by so many rays a pixel; counters: `lobe_rays`, `pixels_traced` grow."""
    found = []
    for index, gbuffer in enumerate(gbuffers):
        rows = np.zeros(0, np.intp) if gloss is None else np.flatnonzero(gloss.traced(gbuffer))
        light = np.zeros((0, 3))
        if len(rows):
            light = traced_lobes(world, gbuffer, rows, rays, ReflectedDirectLight(world), seed + (index << 32), counters)
            counters["pixels_traced"] += len(rows)
        found.append(Traced(rows, light))
    return found


def alone_of(
    world: World, gbuffers: Sequence[GBuffer], looks: Sequence[Mapping[str, Look]], gloss: Gloss | None, price: Price, seed: int,
    counters: Counter[str],
) -> list[Traced]:  # fmt: skip
    """Glossy pixels of each view that were too few for a record, traced; counters: `lobe_rays`, `pixels_alone` grow."""
    found = []
    for index, (gbuffer, look) in enumerate(zip(gbuffers, looks, strict=True)):
        rows, light = np.zeros(0, np.intp), np.zeros((0, 3))
        if gloss is not None:
            rows = look[GLOSSY].view.canvas.alone
            incoming = ReflectedDirectLight(world)
            light = traced_alone(world, gbuffer, rows, gloss, price, incoming, seed + (index << 32), counters)
        found.append(Traced(rows, light))
    return found


def _view(world: World, gbuffer: GBuffer, canvas: Canvas) -> View:
    return View(canvas, Sites(*receivers_of(world, gbuffer, canvas.rows)))
