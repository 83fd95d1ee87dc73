"""What one-bounce methods share: G-buffer, direct light, and then the bounce, sub-pixel by sub-pixel.

Not a method of its own: `ir`, `flc`, the trees of virtual lights, `rsm`, `ssdo` and `dss` say what they prepare for a frame and how
its pixels receive the bounce.
"""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame, Stopwatch
from renderers.method import Context, Method, Settings, Transport, setting
from renderers.scene.model import Scene
from renderers.scene.world import World, rest_bounds

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer

SOFTWARE_DEVICES = ("llvmpipe", "softpipe", "swrast")
CLAMP_SHARE = 0.01


class OneBounceSettings(Settings):
    """Settings of the methods that keep to what the camera or the lights see."""

    eps_b: float | None = setting(
        None, "clamp on the squared distance; empty: (1 % of the scene's radius)²", unit="m²", source="Laurent 2018 eq. 2.19", ge=0
    )
    light_samples: int = setting(16, "samples of area lights and environment, per shaded point", ge=1, le=4096)
    direct_visibility: Literal["raycast", "shadow-map"] = setting("raycast", "shadows of the direct layer")
    backend: Literal["auto", "gl", "cpu"] = setting("auto", "where G-buffer and bounce run; auto: by a table on the device string")


class OneBounce(Method):
    """Direct light plus one bounce; subclasses bring the bounce."""

    pass_name: ClassVar[str]

    def transport(self, settings: Any) -> Transport:
        """One bounce, its indirect segment unoccluded."""
        return "one-bounce-unoccluded"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in `eps_b` from the scene's radius and `backend` from the device string."""
        return settings.model_copy(
            update={"eps_b": clamp_of(scene, settings.eps_b), "backend": backend_of(settings.backend, "none", device)}
        )

    @abstractmethod
    def warm_up(self, world: World, settings: Any) -> None:
        """Import, compile and upload, so that no measured pass pays for it."""

    @abstractmethod
    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> Any:
        """What a frame needs before its pixels, in timed passes; handed to `bounce`."""

    @abstractmethod
    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: Any, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Indirect light at every pixel, float32 (H, W, 3). lit: emission and direct light there."""

    def direct(
        self, world: World, gbuffer: GBuffer, made: Any, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Emission, background and direct light, float32 (H, W, 3)."""
        return direct_layer(world, gbuffer, settings, seed, counters)

    def notes(self, scene: Scene, settings: Any) -> tuple[str, ...]:
        """What the reader of a report should know of this frame."""
        return ()

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            from renderers.transport.raycast import caster_of

            caster_of(world)
            self.warm_up(world, settings)
        made = self.prepare(scene, world, settings, context, counters)
        direct = np.zeros((context.size[1], context.size[0], 3), np.float64)
        indirect = np.zeros_like(direct)
        k, backend = settings.subpixels, getattr(settings, "backend", "cpu")
        for index in range(k * k):
            seed, offset = context.seed + (index << 32), ((index % k + 0.5) / k, (index // k + 0.5) / k)
            with timed(watch, "gbuffer", "render", backend == "gl"):
                gbuffer = make_gbuffer(world, context.size, offset, backend)
            with timed(watch, "direct", "render", settings.direct_visibility == "shadow-map"):
                lit = self.direct(world, gbuffer, made, settings, seed, counters)
            with timed(watch, self.pass_name, "render", backend == "gl"):
                indirect += self.bounce(world, gbuffer, lit, made, settings, seed, counters)
            direct += lit
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        layers = {"direct": (direct / k**2).astype(np.float32), "indirect": (indirect / k**2).astype(np.float32)}
        layers["beauty"] = layers["direct"] + layers["indirect"]
        return Frame(layers, watch.timings, dict(sorted(counters.items())), {"backend": backend}, self.notes(scene, settings))


def clamp_of(scene: Scene, eps_b: float | None) -> float:
    """The clamp in m²: as given, or (CLAMP_SHARE of the scene's radius)²; independent of N, so more VPLs converge to one image."""
    return (CLAMP_SHARE * rest_bounds(scene)[1]) ** 2 if eps_b is None else eps_b


def backend_of(backend: str, visibility: str, device: str) -> str:
    """The table behind `auto`: ray casting and software rasterisers → cpu, anything else → gl."""
    if visibility == "raycast":
        return "cpu"
    if backend != "auto":
        return backend
    return "cpu" if is_software(device) else "gl"


def is_software(device: str) -> bool:
    """Whether a device string is that of a software rasteriser."""
    return any(name in device.lower() for name in SOFTWARE_DEVICES)


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
