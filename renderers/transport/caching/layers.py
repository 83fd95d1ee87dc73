"""Caches in use: the indirect light of one view after another, from records that are added where a view lacks them.

`IrradianceCache` serves diffuse pixels, `RadianceCache` glossy ones; both keep their records between views of one World. `Passes`
puts them together and traces what no record holds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Stopwatch
from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.caching.glossy import reflected
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.placement import Compute, Placement, fill
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.reflectance import Gloss, Lobes, stand_in_albedo
from renderers.transport.caching.sight import in_sight
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.traced import Price, few_at, notes_on_lobes, traced_alone, traced_lobes
from renderers.transport.direct import receivers_of
from renderers.transport.raycast import caster_of

F64 = NDArray[np.float64]
Distances = Callable[[Sites], F64]
# Σ w E' and Σ w of records, float32 (H, W, 4), and the pairs tested
Splat = Callable[[GBuffer, Records, Placement], tuple[NDArray[np.float32], int]]


class IrradianceCache:
    """Irradiance records of a World. most: at most so many; None: no limit.

    splat: how records that a view finds are splatted; None: by its canvas.
    """

    def __init__(
        self, world: World, compute: Compute, distances: Distances, placement: Placement, most: int | None = None,
        splat: Splat | None = None,
    ) -> None:  # fmt: skip
        self.world, self.placement, self.records = world, placement, Records.empty()
        self._compute, self._distances, self._most, self._splat = compute, distances, most, splat

    def few(self, gbuffer: GBuffer, rows: NDArray[np.intp]) -> F64:
        """Fewest pixels that a record is made for, at pixels (flat indices): (P,)."""
        return np.zeros(len(rows))

    def light(self, gbuffer: GBuffer, albedo: F64, watch: Stopwatch, counters: Counter[str]) -> F64:
        """Reflected radiance (H·W, 3) where albedo (H, W, 3) isn't black, 0 elsewhere. counters: `splats`, `pixels_missed`."""
        canvas = self.filled(gbuffer, albedo.max(axis=2) > 0, watch, counters)
        image = np.zeros((gbuffer.triangle.size, 3))
        image[canvas.rows] = canvas.irradiance * albedo.reshape(-1, 3)[canvas.rows] / np.pi
        return image

    def filled(self, gbuffer: GBuffer, wanted: NDArray[np.bool_], watch: Stopwatch, counters: Counter[str]) -> Canvas:
        """A canvas over the wanted pixels (H, W), with all records on it, old ones and those that it needed."""
        canvas, how = Canvas.of(gbuffer, wanted), self.placement
        canvas.few = self.few(gbuffer, canvas.rows)
        blocked = caster_of(self.world).occluded
        with watch("splat"):
            if how.sees:
                self.records = in_sight(self.records, canvas, how.a, how.weight, blocked)
            if self._splat is None:
                canvas.add(self.records, how.a, how.weight, how.gradients, counters)
            elif len(self.records):
                sums, pairs = self._splat(gbuffer, self.records, how)
                canvas.sums += sums.reshape(-1, 4)[canvas.rows]
                counters["splat_tests"] += pairs
        with watch("records"):
            sites = Sites(*receivers_of(self.world, gbuffer, canvas.rows))
            most = None if self._most is None else self._most - len(self.records)
            self.records = fill(canvas, sites, self._compute, self._distances, how, self.records, most, blocked)
        counters["pixels_missed"] += int(np.count_nonzero(canvas.missed))
        return canvas


class RadianceCache(IrradianceCache):
    """Radiance records of a World's glossy surfaces, of the order of `gloss`."""

    def __init__(
        self, world: World, gloss: Gloss, price: Price, compute: Compute, distances: Distances, placement: Placement,
        most: int | None = None, splat: Splat | None = None,
    ) -> None:  # fmt: skip
        super().__init__(world, compute, distances, placement, most, splat)
        self.gloss, self.price = gloss, price

    def few(self, gbuffer: GBuffer, rows: NDArray[np.intp]) -> F64:
        """See `IrradianceCache.few`."""
        return few_at(self.gloss, gbuffer, rows, self.price)

    def glossy_light(self, gbuffer: GBuffer, watch: Stopwatch, counters: Counter[str]) -> tuple[F64, NDArray[np.intp]]:
        """Reflected radiance (H·W, 3) of the pixels that `gloss` caches, 0 elsewhere; and those (flat indices) too few for it."""
        canvas, how = self.filled(gbuffer, self.gloss.cached(gbuffer), watch, counters), self.placement
        image = np.zeros((gbuffer.triangle.size, 3))
        with watch("glossy splat"):
            lobes = Lobes(self.world, gbuffer, canvas.rows, self.gloss)
            image[canvas.rows] = reflected(canvas, self.records, lobes, how.a, how.weight, how.gradients, counters)
        return image, canvas.alone


class Passes:
    """Indirect light of all pixels. gloss: None where glossy surfaces count as diffuse ones of the same mean albedo. lobe_rays:
    of a pixel whose lobe no record holds."""

    def __init__(
        self,
        world: World,
        diffuse: IrradianceCache,
        glossy: RadianceCache | None,
        gloss: Gloss | None,
        lobe_rays: int,
        incoming: Incoming,
    ) -> None:
        self.world, self.diffuse, self.glossy, self.gloss = world, diffuse, glossy, gloss
        self._rays, self._incoming = lobe_rays, incoming
        self._traced = 0

    def light(self, gbuffer: GBuffer, seed: int, watch: Stopwatch, counters: Counter[str]) -> F64:
        """Radiance (H·W, 3) of a view; counters: those of the caches, `radiance_records` and `pixels_traced` are added to."""
        if self.gloss is None:
            return self.diffuse.light(gbuffer, stand_in_albedo(self.world, gbuffer), watch, counters)
        image = self.diffuse.light(gbuffer, self.gloss.diffuse(self.world, gbuffer), watch, counters)
        if self.glossy is not None:
            before = len(self.glossy.records)
            light, alone = self.glossy.glossy_light(gbuffer, watch, counters)
            image += light
            counters["radiance_records"] += len(self.glossy.records) - before
            with watch("lobes"):
                how = self.gloss, self.glossy.price, self._incoming
                image[alone] += traced_alone(self.world, gbuffer, alone, *how, seed, counters)
        rows = np.flatnonzero(self.gloss.traced(gbuffer))
        if len(rows):
            with watch("lobes"):
                image[rows] += traced_lobes(self.world, gbuffer, rows, self._rays, self._incoming, seed, counters)
            counters["pixels_traced"] += len(rows)
            self._traced += len(rows)
        return image

    @property
    def notes(self) -> tuple[str, ...]:
        """What a result has to say about lobes that no record holds."""
        return notes_on_lobes(self.gloss, self._traced, self._rays)
