"""Radiance cache splatting (Gautron 2006, chapter 4): one bounce computed at few records, splatted on the pixels around them.

    E_k      = ∫ L_i cos θ dω over the hemisphere of record k, with its gradients ∇_t, ∇_r and harmonic mean distance R_k
    w_k(p)   = 1 / (|p - p_k| / R_k + √(1 - n·n_k)),   used where w_k ≥ 1/a
    L(p)     = L_e + L_direct + ρ/π · Σ w_k max(0, E_k + (n_k × n)·∇_rE_k + (p - p_k)·∇_tE_k) / Σ w_k

Glossy pixels have records of their own: coefficients λ_k of the incoming radiance in hemispherical harmonics, with gradients,
turned to the pixel's frame and multiplied with those of its BRDF: Σ w_k max(0, Σ_i c_i λ'_i) / Σ w_k. Lobes that no order up to 12
holds are traced from each pixel instead.

Passes: gbuffer, records (cache misses found, thinned, computed in batches), splat, glossy splat, lobes, direct. The image doesn't
depend on the order of the records, and after the records every pixel is reached by one.

| setting       | default | unit | range                         | meaning                                                    |
| ------------- | ------- | ---- | ----------------------------- | ---------------------------------------------------------- |
| a             | 0.15    | 1    | 0.01 … 1.4                    | accuracy: zones have radius a·R                            |
| rays          | 4096    | 1    | 16 … 65536                    | rays a record                                              |
| sampler       | polar   |      | auto, polar, hemicube, plane  | rays all over a hemisphere, five faces of texels drawn by  |
|               |         |      |                               | OpenGL, rays through one plane; auto: by a table           |
| hemicube_shadows | auto |      | auto, cast, mapped            | of what hemicubes see: rays, or OpenGL's shadow maps       |
| weight        | ward    |      | ward, shifted, tent           | weighting function                                         |
| gradients     | true    |      |                               | extrapolate with gradients                                 |
| r_min         | 0.03    | r    | 10⁻⁶ … 1                      | smallest R, in scene radii                                 |
| r_max         | 2       | r    | 10⁻⁶ … 1000                   | largest R, in scene radii                                  |
| footprint     | 1       | px   | 0 … 100                       | smallest reach a·R of a record, in pixels                  |
| placement     | auto    |      | split-sphere, bounded,        | R from distances or from curvature, limited by the         |
|               |         |      | hessian, hessian-bounded      | gradient or not                                            |
| neighbours    | false   |      |                               | neighbour clamping of R                                    |
| order         | batched |      | batched, sequential           | misses found for the whole image, or one by one            |
| records       | none    | 1    | 1 … 10⁶                       | at most so many records (progressive); none: no limit      |
| bounces       | one     |      | one, all                      | one bounce, or all, from a coarse cache of surface light   |
| glossy        | records |      | records, diffuse              | glossy surfaces by radiance records, or as diffuse ones    |
| glossy_a      | 0.15    | 1    | 0.01 … 1                      | accuracy of radiance records                               |
| glossy_rays   | 16384   | 1    | 16 … 65536                    | rays a radiance record                                     |
| glossy_pixels | auto    | 1    | 1 … 65536                     | fewest pixels that a radiance record is made for           |
| harmonics     | auto    | 1    | 2 … 16                        | order of radiance records; auto: by material, up to 12     |
| sharp         | traced  |      | traced, truncated             | lobes beyond the order                                     |
| lobe_rays     | 256     | 1    | 1 … 4096                      | rays a pixel of a traced lobe                              |
| light_samples | 16      | 1    | 1 … 4096                      | samples of area lights and sky, per pixel of the direct layer |
| backend       | auto    |      | auto, gl, cpu                 | where records that a view finds are splatted               |
| subpixels     | 1       | 1    | 1 … 8                         | k: average k×k G-buffers, with common records              |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from renderers.frame import Frame
from renderers.method import Claim, Context, Method, Transport, register, setting
from renderers.methods.one_bounce import is_software
from renderers.methods.ray_records import (
    PILOT_RAYS,
    RecordSettings,
    chosen_placement,
    glossy_placement_of,
    placement_of,
    price_of,
    warm_up,
)
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.caching.incoming import Incoming
    from renderers.transport.caching.layers import Passes, Splat
    from renderers.transport.caching.placement import Compute, Placement
    from renderers.transport.caching.records import Records

SOURCE = "Gautron 2006 §4"


class RcsSettings(RecordSettings):
    """Settings of radiance cache splatting."""

    sampler: Literal["auto", "polar", "hemicube", "plane"] = setting(
        "polar",
        "rays all over a hemisphere, five faces of texels drawn by OpenGL, or (irradiance alone) rays through one square plane, its"
        " border stretched; auto: polar",
        source="Gautron 2006 §4.2; Cohen & Greenberg 1985",
    )
    hemicube_shadows: Literal["auto", "cast", "mapped"] = setting(
        "auto",
        "light of what hemicubes see: by shadow rays, or (one bounce alone) by shadow maps; auto: by a table on the device string",
    )
    placement: Literal["auto", "split-sphere", "bounded", "hessian", "hessian-bounded"] = setting(
        "auto",
        "R from distances or from the curvature of the irradiance, limited by its gradient or not; auto: hessian but for the plane",
        source="Ward 1988; Křivánek et al. 2005; Schwarzhaupt et al. 2012",
    )
    neighbours: bool = setting(False, "neighbour clamping of R", source="Křivánek et al. 2006")
    records: int | None = setting(None, "at most so many records; empty: no limit", source="Gautron 2006 §4.7", ge=1, le=10**6)
    bounces: Literal["one", "all"] = setting(
        "one", "one bounce, or all: hits of rays reflect the light of a coarse cache too", source="Ward 1988"
    )
    backend: Literal["auto", "gl", "cpu"] = setting(
        "auto", "where a view's splat of earlier views' records runs; auto: by a table on the device string"
    )

    @model_validator(mode="after")
    def _lit_by_maps(self) -> RcsSettings:
        """Raises ValueError where shadow maps don't know the light that is asked for."""
        if self.hemicube_shadows == "mapped" and self.bounces == "all":
            raise ValueError("hemicube_shadows=mapped knows direct light alone: bounces=all needs cast or auto")
        return self


class RadianceCacheSplatting(Method):
    """Direct light plus one bounce, interpolated between records."""

    name = "rcs"
    title = "Radiance cache splatting"
    source = "Gautron 2006 chapter 4"
    Settings = RcsSettings
    claims: ClassVar = {
        "diffuse": Claim("approximated", "indirect light is interpolated between records, within the accuracy a"),
        "glossy": Claim("approximated", "indirect light is interpolated between radiance records; sharper lobes are traced"),
        "specular": Claim("approximated", "lobes are traced by a few rays a pixel: noise"),
    }

    def transport(self, settings: Any) -> Transport:
        """One bounce, both visibilities, or all."""
        return "one-bounce" if settings.bounces == "one" else "full"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in the sampler, where its hits are lit, the placement, and where records are splatted."""
        shadows = shadows_of(settings.hemicube_shadows, settings.bounces, device)
        changes = {"sampler": sampler_of(settings.sampler), "hemicube_shadows": shadows}
        if settings.backend == "auto":
            changes["backend"] = "cpu" if is_software(device) else "gl"
        settings = settings.model_copy(update=changes)
        return settings.model_copy(update={"placement": chosen_placement(settings)})

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            warm_up(world)
        passes = passes_of(world, settings, context, counters)
        from renderers.transport.direct import direct, emitted
        from renderers.transport.primary import cast_gbuffer

        layers = {name: np.zeros((context.size[1], context.size[0], 3)) for name in ("direct", "indirect")}
        k = settings.subpixels
        for index in range(k * k):
            seed = context.seed + (index << 32)
            with watch("gbuffer"):
                gbuffer = cast_gbuffer(world, context.size, ((index % k + 0.5) / k, (index // k + 0.5) / k))
            layers["indirect"] += passes.light(gbuffer, seed, watch, counters).reshape(layers["indirect"].shape)
            with watch("direct"):
                layers["direct"] += emitted(world, gbuffer) + direct(
                    world, gbuffer, settings.light_samples, seed, counters=counters
                )
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        images = {name: (layer / k**2).astype(np.float32) for name, layer in layers.items()}
        images["beauty"] = images["direct"] + images["indirect"]
        return Frame(images, watch.timings, dict(sorted(counters.items())), notes=passes.notes)


def sampler_of(sampler: str) -> str:
    """`auto` is polar: hemicubes take longer for the same error, drawn by llvmpipe and by a GPU (docs/methods/rcs.md)."""
    return "polar" if sampler == "auto" else sampler


def shadows_of(shadows: str, bounces: str, device: str) -> str:
    """The table behind `hemicube_shadows=auto`: software rasterisers and all bounces → cast, others → mapped."""
    if shadows != "auto":
        return shadows
    return "cast" if is_software(device) or bounces == "all" else "mapped"


def passes_of(world: World, settings: Any, context: Context, counters: Counter[str]) -> Passes:
    """The caches that the scene needs, empty: no radiance records without glossy materials."""
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.layers import IrradianceCache, Passes, RadianceCache
    from renderers.transport.caching.reflectance import gloss_of

    seed, height = context.seed, context.size[1]
    incoming: Incoming = ReflectedDirectLight(world)
    if settings.bounces == "all":
        incoming = all_bounces(world, incoming, context, counters)
    pilot = PolarSampler(world, grid_of(PILOT_RAYS), incoming, seed, counters=counters).distances
    sampler_of_order = samplers_of(world, incoming, settings, context, counters)
    splat = gl_splat(world) if settings.backend == "gl" else None
    diffuse = IrradianceCache(
        world, sampler_of_order(None), pilot, placement_of(world, height, settings, seed), settings.records, splat
    )
    gloss = gloss_of(world, settings.harmonics, settings.sharp == "truncated") if settings.glossy == "records" else None
    if gloss is None or not gloss.shiny:
        return Passes(world, diffuse, None, None, settings.lobe_rays, incoming)
    radiance = None
    if gloss.order:
        with context.watch("warm-up", "prepare"):
            from renderers.transport.caching.glossy import warm_up as prepare_turns

            prepare_turns(gloss.order)
        how = glossy_placement_of(world, height, settings, seed)
        price, compute = price_of(settings), sampler_of_order(gloss.order)
        radiance = RadianceCache(world, gloss, price, compute, pilot, how, settings.records, splat)
    return Passes(world, diffuse, radiance, gloss, settings.lobe_rays, incoming)


def samplers_of(
    world: World, incoming: Incoming, settings: Any, context: Context, counters: Counter[str]
) -> Callable[[int | None], Compute]:
    """What computes irradiance records (None) and radiance records of an order. The plane is for irradiance alone.

    Hemicubes with shadow maps are lit where they are drawn; of others the triangles alone are drawn.
    """
    from renderers.transport.caching.cube import size_of
    from renderers.transport.caching.hemicube import HemicubeSampler, Rasteriser
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.plane import PlaneSampler, side_of
    from renderers.transport.caching.radiance import RadianceSampler
    from renderers.transport.raycast import OFFSET

    seed = context.seed
    rasteriser: Rasteriser | None = None
    if settings.sampler == "hemicube":
        from renderers.gl.hemicube import LitHemicubes, Triangles

        with context.watch("shadow maps"):
            rasteriser = LitHemicubes(world, OFFSET) if settings.hemicube_shadows == "mapped" else Triangles(world, OFFSET)

    def sampler(order: int | None) -> Compute:
        rays = settings.rays if order is None else settings.glossy_rays
        if rasteriser is not None:
            return HemicubeSampler(world, size_of(rays), incoming, seed, order, rasteriser, counters)
        if order is not None:
            return RadianceSampler(world, grid_of(rays), incoming, order, seed, counters=counters)
        if settings.sampler == "plane":
            return PlaneSampler(world, incoming, seed, side_of(rays), counters=counters)
        return PolarSampler(world, grid_of(rays), incoming, seed, counters=counters)

    return sampler


def gl_splat(world: World) -> Splat:
    """The splat of `renderers.gl.caching`."""
    from renderers.gl.caching import splat_records

    def splat(gbuffer: GBuffer, records: Records, how: Placement) -> tuple[NDArray[np.float32], int]:
        return splat_records(gbuffer, world, records.columns(np.float32), how.a, how.weight, how.gradients)

    return splat


def all_bounces(world: World, direct: Incoming, context: Context, counters: Counter[str]) -> Incoming:
    """Direct light reflected, with the light of a coarse cache made for what the camera sees."""
    from renderers.transport.caching.bounces import AllReflectedLight, anchors_of
    from renderers.transport.caching.records import Sites
    from renderers.transport.direct import receivers_of
    from renderers.transport.primary import cast_gbuffer

    with context.watch("anchors"):
        gbuffer = cast_gbuffer(world, context.size)
        sites = Sites(*receivers_of(world, gbuffer, np.flatnonzero(gbuffer.covered)))
        return AllReflectedLight(world, direct, anchors_of(world, sites, direct, context.seed, counters))


register(RadianceCacheSplatting)
