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

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Stopwatch
from renderers.method import Claim, Context, Settings, Transport, register, setting
from renderers.methods.one_bounce import OneBounce, backend_of, clamp_of, timed
from renderers.scene.model import Scene
from renderers.scene.surface import rest_surface
from renderers.scene.world import LAMBERT, World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.resampling.points import Points
    from renderers.transport.vpl import Vpls

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


class InstantRadiosity(OneBounce):
    """Direct light plus one diffuse bounce through virtual point lights."""

    name = "ir"
    title = "Instant radiosity"
    source = "Keller 1997; Laurent 2018 chapters 3 and 4"
    pass_name = "gather"
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

    def warm_up(self, world: World, settings: Any) -> None:
        """Kernels or shaders of the sampler and the gather."""
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

    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> Any:
        """The virtual lights."""
        points = resampled(world, settings, context.seed, context.watch)
        with context.watch("vpls"):
            return light_of(world, points, settings, context.seed, counters)

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: Any, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """The light of all of them."""
        return gather_vpls(world, gbuffer, made, settings, counters)


def eta_of(scene: Scene, settings: Any) -> float | None:
    """η* in m²: as given, or the scene's rest area over N; of the rest pose, so that it doesn't change with animation."""
    if settings.sampler != "resampled" or settings.eta is not None:
        return settings.eta  # type: ignore[no-any-return]
    return rest_surface(scene) / settings.vpls  # type: ignore[no-any-return]


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
