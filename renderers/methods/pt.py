"""Path tracing with Mitsuba 3: the yardstick that every method's speed against error is read from.

Unidirectional, light and BRDF sampling combined by multiple importance sampling (Veach 1997), Russian roulette from depth 5.
The image is the mean of `spp` paths a pixel; its error falls with 1/√spp, which everyone can scale.

    L = (1/spp) Σ_k  Le + Σ_bounces throughput · (w_light f cos L_light / p_light  +  w_brdf f cos L_hit / p_brdf)

Passes: export (Scene to Mitsuba, acceleration structure), warm-up (kernel compilation, no paths), paths.

| setting | default | what it does |
| --- | --- | --- |
| transport | full | which light paths are traced, as in references |
| spp | 64 | paths a pixel (and sub-pixel) |
| seconds | none | a budget, turned into spp by `plan`, before the render |
| pixel | centre | where paths start: pixel centre (as references in comparisons), or spread over the pixel |
| subpixels | 1 | k×k sample points a pixel, each with `spp` paths |
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame, Stopwatch
from renderers.method import Claim, Context, Method, Settings, Transport, register, setting
from renderers.scene.model import Scene

PILOT_SPP = 4
PILOT_SHARE = 0.05
MOST_SPP = 1 << 20
SOURCE = "Kajiya 1986; Mitsuba 3"


class PathTracingSettings(Settings):
    """Settings of `pt`."""

    transport: Transport = setting("full", "light paths that are traced", source=SOURCE)
    spp: int = setting(64, "paths a pixel", unit="paths/pixel", source=SOURCE, ge=1, le=MOST_SPP)
    seconds: float | None = setting(
        None, "time budget, turned into spp by a pilot when an evaluation is planned", unit="s", gt=0, le=86400
    )
    pixel: Literal["centre", "box"] = setting(
        "centre", "start of the paths: the pixel centre, or spread over the pixel (box filter)"
    )


class PathTracing(Method):
    """Unidirectional path tracing, unbiased."""

    name: ClassVar[str] = "pt"
    title: ClassVar[str] = "Path tracing"
    source: ClassVar[str] = SOURCE
    Settings: ClassVar[type[Settings]] = PathTracingSettings
    claims: ClassVar[dict[str, Claim]] = {}

    def transport(self, settings: PathTracingSettings) -> Transport:
        """The transport that was asked for."""
        return settings.transport

    def plan(self, scene: Scene, settings: PathTracingSettings, size: tuple[int, int], frame: int = 0) -> PathTracingSettings:
        """Settings whose `spp` fills `seconds` on this machine, by timing a pilot; unchanged without `seconds`.

        The pilot is quadrupled until it takes PILOT_SHARE of the budget, then scaled up; its fixed cost counts with the paths.
        """
        if settings.seconds is None:
            return settings
        spp = PILOT_SPP
        took = self._timed(scene, settings, spp, size, frame)
        while took < PILOT_SHARE * settings.seconds and spp < MOST_SPP:
            spp *= 4
            took = self._timed(scene, settings, spp, size, frame)
        spp = int(np.clip(spp * settings.seconds / max(took, 1e-9), 1, MOST_SPP))
        return settings.model_copy(update={"spp": spp, "seconds": None})

    def _timed(self, scene: Scene, settings: PathTracingSettings, spp: int, size: tuple[int, int], frame: int) -> float:
        """Seconds of the render stage with `spp` paths a pixel, the better of two."""
        trial = settings.model_copy(update={"spp": spp, "seconds": None})
        frames = [self._render(scene, trial, Context(size, seed, frame, Stopwatch())) for seed in (0, 1)]
        return min(sum(t.wall_s for t in f.timings if t.stage == "render") for f in frames)

    def _render(self, scene: Scene, settings: PathTracingSettings, context: Context) -> Frame:
        if settings.seconds is not None:
            raise ValueError("pt: `seconds` must become `spp` first (pt.plan): a render is a pure function of its settings")
        from renderers.reference.replicates import is_lit

        width, height = context.size
        world = scene.world(context.frame)
        lit = is_lit(world, settings.transport)
        beauty = _traced(world, settings, context) if lit else np.zeros((height, width, 3), np.float32)
        layers = {"beauty": beauty}
        if settings.transport == "direct":
            layers |= {"direct": beauty, "indirect": np.zeros_like(beauty)}
        paths = width * height * settings.spp * settings.subpixels**2
        return Frame(
            layers, context.watch.timings, {"paths": paths, "spp": settings.spp}, device={"renderer": "mitsuba llvm_ad_rgb"}
        )


def _traced(world: Any, settings: PathTracingSettings, context: Context) -> NDArray[np.float32]:
    """Mean radiance, float32 (H, W, 3)."""
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.sampling import grid_sizes, mean_image, method_stream
    from renderers.reference.transports import estimator

    watch = context.watch
    with watch("export", "prepare"):
        scene = mitsuba_scene(world, context.size, clay=settings.transport == "ambient-occlusion")
        estimate = estimator(settings.transport, scene)
    parts = grid_sizes(settings.spp)
    points = _points(settings.subpixels, settings.pixel)
    with watch("warm-up", "prepare"):
        for part in sorted(set(parts)):
            mean_image(scene, estimate, context.size, part, method_stream(context.seed, 0, context.frame), points[0], active=False)
    total = np.zeros((context.size[1], context.size[0], 3))
    with watch("paths"):
        for number, (point, part) in enumerate((point, part) for point in points for part in parts):
            stream = method_stream(context.seed, number, context.frame)
            total += mean_image(scene, estimate, context.size, part, stream, point) * part
    return (total / (settings.spp * len(points))).astype(np.float32)


def _points(k: int, pixel: str) -> list[tuple[float, float] | None]:
    """Sample points in the pixel: centres of k×k cells; None, the whole pixel, for the box filter."""
    if pixel == "box":
        return [None] * k**2
    return [((i + 0.5) / k, (j + 0.5) / k) for j in range(k) for i in range(k)]


register(PathTracing)
