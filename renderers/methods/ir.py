"""Instant radiosity (Keller 1997): one diffuse bounce as the light of N virtual point lights, gathered at every pixel.

    y_n ~ 1/|S| on all surfaces                       I_n = ρ(y_n)/π · E(y_n) · |S|/N
    L(x) = L_e + L_direct + Σ_n f_r(x; y_n → x → eye) · ⟨n_x, l⟩⁺ ⟨n_y, -l⟩⁺ / max(ε_b, r²) · I_n  [· V(x, y_n)]

Laurent 2018, equations 2.19, 3.2 and 4.2, algorithms 2 to 4 with one level of weight 1. The clamp ε_b bounds 1/r² and is the only
bias besides ignoring V: with eps_b = 0 and visibility = raycast the estimate is unbiased where the sources are diffuse. Passes:
vpls (points and their shadowed direct irradiance), gbuffer, direct, gather.

| setting           | default          | unit | range                    | meaning                                             |
| ----------------- | ---------------- | ---- | ------------------------ | --------------------------------------------------- |
| vpls              | 1024             | 1    | 1 … 2²⁴                  | N, points on the surfaces; each lit side is one VPL |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                      | clamp on the squared distance, the same for every N |
| visibility        | none             |      | none, raycast            | occlusion between VPL and receiver                  |
| sampler           | uniform          |      | …, resampled             | points by area: independent, an Owen-scrambled      |
|                   |                  |      |                          | Sobol' set, or resampled triangle by triangle       |
| eta               | rest area / N    | m²   | > 0                      | resampled: η*, surface area of one point            |
| light_samples     | 16               | 1    | 1 … 4096                 | samples of area lights and sky, per pixel and VPL   |
| direct_visibility | raycast          |      | raycast, shadow-map      | shadows of the direct layer                         |
| backend           | auto             |      | auto, gl, cpu            | auto: a fixed table on the device string            |
| subpixels         | 1                | 1    | 1 … 8                    | k: average k×k G-buffers                            |
"""

from __future__ import annotations

import contextlib
from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame, Stopwatch
from renderers.method import Claim, Context, Method, Settings, Transport, register, setting
from renderers.scene.model import Scene
from renderers.scene.surface import rest_surface
from renderers.scene.world import LAMBERT, World, rest_bounds

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.resampling.points import Points
    from renderers.transport.vpl import Vpls

SOFTWARE_DEVICES = ("llvmpipe", "softpipe", "swrast")
CLAMP_SHARE = 0.01
SOURCE = "Laurent 2018 §4.2"
# Whether GL shaders have been compiled, as drivers do it in the first draw, for Worlds without and with textures.
_COMPILED: set[bool] = set()


class IrSettings(Settings):
    """Settings of instant radiosity."""

    vpls: int = setting(1024, "N, number of points drawn on the surfaces", source="Laurent 2018 eq. 4.2", ge=1, le=1 << 24)
    eps_b: float | None = setting(
        None,
        "clamp on the squared distance; empty: (1 % of the scene's radius)²; 0: no clamp",
        unit="m²",
        source="Laurent 2018 eq. 2.19",
        ge=0,
    )
    visibility: Literal["none", "raycast"] = setting("none", "occlusion between virtual light and receiver", source=SOURCE)
    sampler: Literal["uniform", "low-discrepancy", "resampled"] = setting(
        "uniform", "independent points, an Owen-scrambled Sobol' set, or points resampled triangle by triangle, stable under motion"
    )
    eta: float | None = setting(
        None,
        "resampled: η*, surface area of one point; empty: area in rest pose / vpls",
        unit="m²",
        source="Laurent 2018 eq. 5.1",
        gt=0,
    )
    light_samples: int = setting(16, "samples of area lights and environment, per pixel and per virtual light", ge=1, le=4096)
    direct_visibility: Literal["raycast", "shadow-map"] = setting("raycast", "shadows of the direct layer")
    backend: Literal["auto", "gl", "cpu"] = setting("auto", "where G-buffer and gather run; auto: by a table on the device string")


class InstantRadiosity(Method):
    """Direct light plus one diffuse bounce through virtual point lights."""

    name = "ir"
    title = "Instant radiosity"
    source = "Keller 1997; Laurent 2018 chapters 3 and 4"
    Settings = IrSettings
    claims: ClassVar = {
        "glossy": Claim("approximated", "exact at the receiver; a glossy source reflects as a diffuse one of its mean albedo"),
        "specular": Claim(
            "approximated", "mirror-like surfaces reflect the virtual lights by their narrow lobe only, sources as diffuse"
        ),
    }

    def transport(self, settings: Any) -> Transport:
        """One bounce, with or without occlusion of the indirect segment."""
        return "one-bounce" if settings.visibility == "raycast" else "one-bounce-unoccluded"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in `eps_b` and `eta` from the scene and `backend` from the device string; ray-cast visibility runs on the CPU."""
        return settings.model_copy(
            update={
                "eps_b": clamp_of(scene, settings.eps_b),
                "eta": eta_of(scene, settings),
                "backend": backend_of(settings.backend, settings.visibility, device),
            }
        )

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            warm_up(world, settings)
        points = resampled(world, settings, context.seed, watch)
        with watch("vpls"):
            vpls = light_of(world, points, settings, context.seed, counters)
        direct = np.zeros((context.size[1], context.size[0], 3), np.float64)
        indirect = np.zeros_like(direct)
        k, on_gl = settings.subpixels, settings.backend == "gl"
        for index in range(k * k):
            offset = ((index % k + 0.5) / k, (index // k + 0.5) / k)
            with timed(watch, "gbuffer", "render", on_gl):
                gbuffer = make_gbuffer(world, context.size, offset, settings.backend)
            with timed(watch, "direct", "render", settings.direct_visibility == "shadow-map"):
                direct += direct_layer(world, gbuffer, settings, context.seed + (index << 32), counters)
            with timed(watch, "gather", "render", on_gl):
                indirect += gather_vpls(world, gbuffer, vpls, settings, counters)
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        layers = {"direct": (direct / k**2).astype(np.float32), "indirect": (indirect / k**2).astype(np.float32)}
        layers["beauty"] = layers["direct"] + layers["indirect"]
        return Frame(layers, watch.timings, dict(sorted(counters.items())), {"backend": settings.backend})


def clamp_of(scene: Scene, eps_b: float | None) -> float:
    """The clamp in m²: as given, or (CLAMP_SHARE of the scene's radius)²; independent of N, so more VPLs converge to one image."""
    return (CLAMP_SHARE * rest_bounds(scene)[1]) ** 2 if eps_b is None else eps_b


def eta_of(scene: Scene, settings: Any) -> float | None:
    """η* in m²: as given, or the scene's rest area over N; of the rest pose, so that it doesn't change with animation."""
    if settings.sampler != "resampled" or settings.eta is not None:
        return settings.eta  # type: ignore[no-any-return]
    return rest_surface(scene) / settings.vpls  # type: ignore[no-any-return]


def backend_of(backend: str, visibility: str, device: str) -> str:
    """The table behind `auto`: ray casting and software rasterisers → cpu, anything else → gl."""
    if visibility == "raycast":
        return "cpu"
    if backend != "auto":
        return backend
    return "cpu" if any(name in device.lower() for name in SOFTWARE_DEVICES) else "gl"


def warm_up(world: World, settings: Any) -> None:
    """Import, compile kernels or shaders, upload geometry and build the ray caster, so that no measured pass pays for it."""
    import renderers.transport.primary
    import renderers.transport.vpl  # noqa: F401
    from renderers.transport.gather import warm_up as compile_gather
    from renderers.transport.raycast import caster_of

    caster_of(world)
    if settings.backend == "cpu":
        if settings.sampler == "resampled":
            from renderers.transport.resampling.points import warm_up as compile_kernels

            compile_kernels()
        compile_gather(settings.visibility == "raycast", bool((world.materials.kind != LAMBERT).any()))
        return
    from renderers.gl.upload import upload

    upload(world)
    textured = bool(world.textures)
    if textured not in _COMPILED:
        from renderers.gl.gather import gather as gather_gl
        from renderers.gl.gbuffer import render_gbuffer

        light = np.zeros((1, 3), np.float32)
        gather_gl(render_gbuffer(world, (1, 1)), world, light, light, light, 0.0)
        _COMPILED.add(textured)
    if settings.sampler == "resampled":
        from renderers.gl.resample import warm_up as compile_shaders

        compile_shaders()


def resampled(world: World, settings: Any, seed: int, watch: Stopwatch, draw: int = 0) -> Points | None:
    """The points of `sampler="resampled"`, drawn on the resolved backend as a pass of their own; None with other samplers.

    draw: 0, 1, … gives further draws of the same vertices' numbers, each one shifted, that fill the gaps of those before.
    """
    if settings.sampler != "resampled":
        return None
    on_gl, area = settings.backend == "gl", settings.eta * world.scale**2
    with timed(watch, "resample", "render", on_gl):
        from renderers.transport.resampling.points import Points, progressive_shift, resample

        if not on_gl:
            return resample(world, area, seed, progressive_shift(draw))
        from renderers.gl.resample import resample as resample_gl
        from renderers.transport.resampling.numbers import keys

        return Points(*resample_gl(world, area, keys(seed), progressive_shift(draw))).sorted()


def light_of(world: World, points: Points | None, settings: Any, seed: int, counters: Counter[str]) -> Vpls:
    """VPLs of resampled points, or else of points drawn over all surfaces by the settings' sampler."""
    from renderers.transport.vpl import emit_resampled, emit_vpls

    if points is None:
        return emit_vpls(world, settings.vpls, seed, settings.sampler, settings.light_samples, counters)
    return emit_resampled(world, points, settings.eta * world.scale**2, settings.light_samples, seed, counters)


def timed(watch: Stopwatch, name: str, stage: Literal["prepare", "render"], on_gl: bool) -> contextlib.AbstractContextManager[None]:
    """The stopwatch for a pass, with GPU seconds where it runs on GL."""
    if not on_gl:
        return watch(name, stage)
    from renderers.gl.timers import timed as timed_gl

    return timed_gl(watch, name, stage)


def make_gbuffer(world: World, size: tuple[int, int], offset: tuple[float, float], backend: str) -> GBuffer:
    """The G-buffer by GL or by ray casting."""
    if backend == "gl":
        from renderers.gl.gbuffer import render_gbuffer

        return render_gbuffer(world, size, offset)
    from renderers.transport.primary import cast_gbuffer

    return cast_gbuffer(world, size, offset)


def direct_layer(world: World, gbuffer: GBuffer, settings: Any, seed: int, counters: Counter[str]) -> NDArray[np.float32]:
    """Emission, background and reflected direct light, float32 (H, W, 3)."""
    from renderers.transport.direct import direct, emitted

    if settings.direct_visibility == "shadow-map":
        from renderers.gl.direct import direct as mapped

        return emitted(world, gbuffer) + mapped(world, gbuffer, light_samples=settings.light_samples)
    return emitted(world, gbuffer) + direct(world, gbuffer, settings.light_samples, seed, counters=counters)


def gather_vpls(world: World, gbuffer: GBuffer, vpls: Vpls, settings: Any, counters: Counter[str]) -> NDArray[np.float32]:
    """Light of all VPLs at every pixel, float32 (H, W, 3)."""
    eps_b = settings.eps_b * world.scale**2
    arrays = (vpls.positions, vpls.normals, vpls.intensities)
    if settings.backend == "gl":
        from renderers.gl.gather import gather as gather_gl

        counters["light_evaluations"] += int(np.count_nonzero(gbuffer.covered)) * len(vpls)
        return gather_gl(gbuffer, world, *arrays, eps_b)
    from renderers.transport.gather import gather
    from renderers.transport.raycast import caster_of

    caster = caster_of(world) if settings.visibility == "raycast" else None
    return gather(gbuffer, world, *arrays, eps_b, caster, counters)


register(InstantRadiosity)
