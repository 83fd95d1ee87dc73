"""Radiance cache splatting (Gautron 2006, chapter 4): one bounce computed at few records, splatted on the pixels around them.

    E_k      = ∫ L_i cos θ dω over the hemisphere of record k, with its gradients ∇_t, ∇_r and harmonic mean distance R_k
    w_k(p)   = 1 / (|p - p_k| / R_k + √(1 - n·n_k)),   used where w_k ≥ 1/a
    L(p)     = L_e + L_direct + ρ/π · Σ w_k max(0, E_k + (n_k × n)·∇_rE_k + (p - p_k)·∇_tE_k) / Σ w_k

Passes: gbuffer, records (cache misses found, thinned, computed in batches), splat, direct. The image doesn't depend on the order of
the records, and after the records every pixel is reached by one.

| setting       | default | unit | range                         | meaning                                                    |
| ------------- | ------- | ---- | ----------------------------- | ---------------------------------------------------------- |
| a             | 0.15    | 1    | 0.01 … 1.4                    | accuracy: zones have radius a·R                            |
| rays          | 4096    | 1    | 16 … 65536                    | rays a record                                              |
| weight        | ward    |      | ward, shifted, tent           | weighting function                                         |
| gradients     | true    |      |                               | extrapolate with gradients                                 |
| r_min         | 0.03    | r    | 10⁻⁶ … 1                      | smallest R, in scene radii                                 |
| r_max         | 2       | r    | 10⁻⁶ … 1000                   | largest R, in scene radii                                  |
| footprint     | 1       | px   | 0 … 100                       | smallest reach a·R of a record, in pixels                  |
| placement     | bounded |      | split-sphere, bounded, hessian | R from distances, limited by the gradient, from curvature |
| neighbours    | false   |      |                               | neighbour clamping of R                                    |
| order         | batched |      | batched, sequential           | misses found for the whole image, or one by one            |
| records       | none    | 1    | 1 … 10⁶                       | at most so many records (progressive); none: no limit      |
| light_samples | 16      | 1    | 1 … 4096                      | samples of area lights and sky, per pixel of the direct layer |
| subpixels     | 1       | 1    | 1 … 8                         | k: average k×k G-buffers, with common records              |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame
from renderers.method import Claim, Context, Method, Settings, Transport, register, setting
from renderers.scene.model import Scene
from renderers.scene.world import LAMBERT, World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.caching.hemisphere import PolarSampler
    from renderers.transport.caching.placement import Placement
    from renderers.transport.caching.records import Sites

    Distances = Callable[[Sites], NDArray[np.float64]]

SOURCE = "Gautron 2006 §4"
PILOT_RAYS = 64


class RcsSettings(Settings):
    """Settings of radiance cache splatting."""

    a: float = setting(0.15, "accuracy: a record reaches a·R far", source="Gautron 2006 eq. 2.8", ge=0.01, le=1.4)
    rays: int = setting(4096, "rays a record", source="Gautron 2006 §4.8", ge=16, le=65536)
    weight: Literal["ward", "shifted", "tent"] = setting(
        "ward", "weighting function", source="Ward 1988; Tabellion & Lamorlette 2004"
    )
    gradients: bool = setting(True, "extrapolate with rotation and translation gradients", source="Ward & Heckbert 1992")
    r_min: float = setting(0.03, "smallest R", unit="r", source="Tabellion & Lamorlette 2004", ge=1e-6, le=1)
    r_max: float = setting(2.0, "largest R", unit="r", source="Tabellion & Lamorlette 2004", ge=1e-6, le=1000)
    footprint: float = setting(
        1.0, "smallest reach of a record, in pixels", unit="px", source="Tabellion & Lamorlette 2004", ge=0, le=100
    )
    placement: Literal["split-sphere", "bounded", "hessian"] = setting(
        "bounded",
        "R from distances alone, limited by the gradient as well, or from the curvature of the irradiance",
        source="Ward 1988; Křivánek et al. 2005; Schwarzhaupt et al. 2012",
    )
    neighbours: bool = setting(False, "neighbour clamping of R", source="Křivánek et al. 2006")
    order: Literal["batched", "sequential"] = setting(
        "batched", "misses found for the whole image and thinned, or one by one", source="luxmeter; Gautron 2006 alg. 4"
    )
    records: int | None = setting(None, "at most so many records; empty: no limit", source="Gautron 2006 §4.7", ge=1, le=10**6)
    light_samples: int = setting(16, "samples of area lights and environment, per pixel of the direct layer", ge=1, le=4096)


class RadianceCacheSplatting(Method):
    """Direct light plus one diffuse bounce, interpolated between records."""

    name = "rcs"
    title = "Radiance cache splatting"
    source = "Gautron 2006 chapter 4"
    Settings = RcsSettings
    claims: ClassVar = {
        "diffuse": Claim("approximated", "indirect light is interpolated between records, within the accuracy a"),
        "glossy": Claim("approximated", "indirect light is reflected as by a diffuse surface of the same mean albedo"),
        "specular": Claim("approximated", "indirect light is reflected as by a diffuse surface of the same mean albedo"),
    }

    def transport(self, settings: Any) -> Transport:
        """One bounce, both visibilities."""
        return "one-bounce"

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            warm_up(world)
        from renderers.transport.caching.placement import fill
        from renderers.transport.caching.records import Records, Sites
        from renderers.transport.caching.splat import Canvas
        from renderers.transport.direct import direct, emitted, receivers_of
        from renderers.transport.primary import cast_gbuffer

        samplers = samplers_of(world, settings, context.seed, counters)
        placement, records = placement_of(world, context.size[1], settings, context.seed), Records.empty()
        layers = {name: np.zeros((context.size[1], context.size[0], 3)) for name in ("direct", "indirect")}
        k = settings.subpixels
        for index in range(k * k):
            with watch("gbuffer"):
                gbuffer = cast_gbuffer(world, context.size, ((index % k + 0.5) / k, (index // k + 0.5) / k))
            albedo = albedos(world, gbuffer)
            canvas = Canvas.of(gbuffer, albedo.max(axis=2) > 0)
            with watch("splat"):
                canvas.add(records, settings.a, settings.weight, settings.gradients, counters)
            with watch("records"):
                sites = Sites(*receivers_of(world, gbuffer, canvas.rows))
                most = None if settings.records is None else settings.records - len(records)
                records = fill(canvas, sites, *samplers, placement, records, most)
            flat = layers["indirect"].reshape(-1, 3)
            flat[canvas.rows] += canvas.irradiance * albedo.reshape(-1, 3)[canvas.rows] / np.pi
            with watch("direct"):
                seed = context.seed + (index << 32)
                layers["direct"] += emitted(world, gbuffer) + direct(
                    world, gbuffer, settings.light_samples, seed, counters=counters
                )
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
            counters["pixels_missed"] += int(np.count_nonzero(canvas.missed))
        images = {name: (layer / k**2).astype(np.float32) for name, layer in layers.items()}
        images["beauty"] = images["direct"] + images["indirect"]
        return Frame(images, watch.timings, dict(sorted(counters.items())))


def samplers_of(world: World, settings: Any, seed: int, counters: Counter[str]) -> tuple[PolarSampler, Distances]:
    """What computes records, and what estimates their radius beforehand from few rays."""
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight

    incoming = ReflectedDirectLight(world)
    pilot = PolarSampler(world, grid_of(PILOT_RAYS), incoming, seed, counters=counters)
    return PolarSampler(world, grid_of(settings.rays), incoming, seed, counters=counters), pilot.distances


def placement_of(world: World, height: int, settings: Any, seed: int) -> Placement:
    """The settings as `caching.placement` takes them, for images so high; radii in scene radii are World units."""
    from renderers.transport.caching.limits import Footprint, Limits
    from renderers.transport.caching.placement import Placement

    pixel = 2 * np.tan(world.camera.yfov / 2) / height
    limits = Limits(
        smallest=min(settings.r_min, settings.r_max),
        largest=settings.r_max,
        gradient=settings.placement == "bounded",
        neighbours=settings.neighbours,
        footprint=Footprint(world.camera.pose[:3, 3], settings.footprint * pixel / settings.a),
        metric="hessian" if settings.placement == "hessian" else "split-sphere",
    )
    return Placement(settings.a, settings.weight, settings.gradients, limits, settings.order, seed)


def albedos(world: World, gbuffer: GBuffer) -> NDArray[np.float64]:
    """Diffuse reflectance of each pixel, of glossy surfaces their mean albedo: float64 (H, W, 3), 0 on the background."""
    from renderers.transport.brdf import materials_at, mean_albedo

    albedo = np.where(gbuffer.covered[..., None], gbuffer.base, 0).astype(np.float64)
    rows = np.flatnonzero(gbuffer.covered & (world.materials.kind[gbuffer.material] != LAMBERT))
    if len(rows):
        flat = albedo.reshape(-1, 3)
        flat[rows] = mean_albedo(materials_at(world.materials, gbuffer.material.ravel()[rows], flat[rows]))
    return albedo


def warm_up(world: World) -> None:
    """Import, compile kernels and build the ray caster, so that no measured pass pays for it."""
    import renderers.transport.primary  # noqa: F401
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.records import Sites
    from renderers.transport.caching.splat import warm_up as compile_splat

    compile_splat()
    up = np.array([[0.0, 0.0, 1.0]])
    PolarSampler(world, grid_of(16), ReflectedDirectLight(world))(Sites(np.zeros((1, 3)), up, up))


register(RadianceCacheSplatting)
