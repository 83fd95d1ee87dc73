"""Photon map shown directly (Jensen 1996): direct light exactly, all bounces by density estimation at every pixel.

    L(x, v) = L_e + L_direct + Σ_i f_r(x; ω_i, v) Φ_i / A          photons i near x on the same surface, after ≥ 1 reflection

`nearest` > 0: the k nearest photons, A = π r_k², the k-th left out (unbiased density); `nearest` = 0: all photons within `radius`.
The disc is too dark where a surface ends inside it; `area = corrected` measures the area that the photons sampled by their convex
hull. The error is noise ∝ 1/√k and blur over the photons' radius; both vanish for photons → ∞ with k → ∞, k / photons → 0.

Passes: photons (trace), tree, gbuffer, direct, density.

| setting       | default | unit | range                     | meaning |
| ------------- | ------- | ---- | ------------------------- | ----------------------------------------------------------------- |
| photons       | 200000  | 1    | 1 … 2²⁶                   | N_e, photons emitted |
| most_stored   | 2·10⁷   | 1    | 1 … 10⁸                   | tracing ends once so many are stored (68 bytes each) |
| nearest       | 50      | 1    | 0 … 4096                  | k; 0: all photons within `radius` |
| radius        | 0.1     | r    | > 0 … 1                   | largest look-up, in scene radii |
| area          | disc    |      | disc, hull, corrected     | area that the photons stand for |
| direct        | raycast |      | raycast, photons          | direct light by shadow rays, or from the photons as well |
| light_samples | 16      | 1    | 1 … 4096                  | samples of area lights and sky per pixel |
| subpixels     | 1       | 1    | 1 … 8                     | k: average k×k G-buffers |
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from renderers.frame import Frame, Stopwatch
from renderers.method import Claim, Context, Method, Settings, Transport, register, setting
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.photons.density import F64
    from renderers.transport.photons.map import PhotonMap

SOURCE = "Jensen 1996"
Stage = Literal["prepare", "render"]


class PhotonSettings(Settings):
    """Settings of every method that traces photons."""

    photons: int = setting(200_000, "N_e, photons emitted", source="Gautron 2006 §6.3", ge=1, le=1 << 26)
    most_stored: int = setting(20_000_000, "tracing ends once so many photons are stored, 68 bytes each", ge=1, le=100_000_000)
    light_samples: int = setting(16, "samples of area lights and sky per pixel, of the direct layer", ge=1, le=4096)


class PhotonMapSettings(PhotonSettings):
    """Settings of `photon-map`."""

    nearest: int = setting(50, "k, photons of an estimate; 0: all within the radius", source=SOURCE, ge=0, le=4096)
    radius: float = setting(0.1, "largest look-up, in scene radii", unit="r", source=SOURCE, gt=0, le=1)
    area: Literal["disc", "hull", "corrected"] = setting("disc", "area the photons stand for", source="Gautron 2006 §6.4")
    direct: Literal["raycast", "photons"] = setting("raycast", "direct light by shadow rays, or from the photons as well")


class PhotonMapping(Method):
    """Direct visualisation of a photon map."""

    name = "photon-map"
    title = "Photon map, direct visualisation"
    source = "Jensen 1996; Gautron 2006 §6.2"
    Settings = PhotonMapSettings
    claims: ClassVar = {
        "specular": Claim("approximated", "mirror-like surfaces show the few photons that leave towards the viewer: noise"),
    }

    def transport(self, settings: Any) -> Transport:
        """All bounces."""
        return "full"

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            warm_up(world)
        photons = traced_map(world, settings, context.seed, settings.direct == "photons", watch, counters)

        def indirect(gbuffer: GBuffer, seed: int) -> F64:
            from renderers.transport.photons.density import lookup, points, reflected
            from renderers.transport.photons.pixels import gatherers

            pixels = gatherers(world, gbuffer)
            where = points(world, pixels.position, pixels.normal, gbuffer.triangle.ravel()[pixels.row])
            how = lookup(settings.nearest, settings.radius, settings.area)
            return pixels.image(gbuffer, reflected(photons, where, pixels.view, pixels.materials, how))

        raycast = settings.direct == "raycast"
        layers = layered(world, settings, context, counters, indirect, "density", raycast)
        captions = add_picture(layers, world, photons, context)
        return Frame(layers, watch.timings, dict(sorted(counters.items())), notes=photons.notes, captions=captions)


def add_picture(layers: dict[str, Any], world: World, photons: PhotonMap, context: Context) -> dict[str, str]:
    """Add the layer debug.photons, no part of the method's time; returns its caption."""
    from renderers.transport.photons.picture import PHOTON_CAPTION, photon_picture
    from renderers.transport.primary import cast_gbuffer

    layers["debug.photons"] = photon_picture(world, cast_gbuffer(world, context.size), photons.photons)
    return {"debug.photons": PHOTON_CAPTION}


def warm_up(world: World) -> None:
    """Compile (or load) the kernels and build the ray caster, so that no measured pass pays for it."""
    from renderers.transport.photons.warm import warm_up as compile_kernels
    from renderers.transport.raycast import caster_of

    caster_of(world)
    compile_kernels()


def traced_map(
    world: World, settings: Any, seed: int, direct: bool, watch: Stopwatch, counters: Counter[str], stage: Stage = "render"
) -> PhotonMap:
    """Trace and build the map of `settings`; direct: with photons straight from the lights."""
    from renderers.transport.photons.map import photon_map
    from renderers.transport.photons.tracing import trace

    with watch("photons", stage):
        traced = trace(world, settings.photons, seed, direct, settings.most_stored, counters=counters)
    with watch("tree", stage):
        photons = photon_map(traced)
    counters["photon_bytes"] += photons.bytes
    return photons


def layered(
    world: World, settings: Any, context: Context, counters: Counter[str], indirect: Any, name: str, raycast: bool = True
) -> dict[str, Any]:
    """Layers direct, indirect and beauty over k×k G-buffers; indirect(gbuffer, seed) gives float (H, W, 3), timed as `name`."""
    from renderers.transport.direct import direct, emitted
    from renderers.transport.primary import cast_gbuffer

    sums = {key: np.zeros((context.size[1], context.size[0], 3)) for key in ("direct", "indirect")}
    k = settings.subpixels
    for index in range(k * k):
        seed = context.seed + (index << 32)
        with context.watch("gbuffer"):
            gbuffer = cast_gbuffer(world, context.size, ((index % k + 0.5) / k, (index // k + 0.5) / k))
        with context.watch("direct"):
            sums["direct"] += emitted(world, gbuffer)
            if raycast:
                sums["direct"] += direct(world, gbuffer, settings.light_samples, seed, counters=counters)
        with context.watch(name):
            sums["indirect"] += indirect(gbuffer, seed)
        counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
    layers = {key: (value / k**2).astype(np.float32) for key, value in sums.items()}
    return layers | {"beauty": layers["direct"] + layers["indirect"]}


register(PhotonMapping)
