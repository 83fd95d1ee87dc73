"""What one-bounce methods share that differ in one pass alone: G-buffer, direct light, and then the bounce, sub-pixel by sub-pixel.

Not a method of its own: `rsm`, `ssdo` and `dss` say what they prepare for a frame and how a pixel receives the bounce.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame
from renderers.method import Context, Method, Settings, Transport, setting
from renderers.methods.ir import backend_of, clamp_of, direct_layer, make_gbuffer, timed
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer


class OneBounceSettings(Settings):
    """Settings of every such method."""

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
    def prepare(self, world: World, settings: Any, context: Context, counters: Counter[str]) -> Any:
        """What a frame needs before its pixels, in timed passes; handed to `bounce`."""

    @abstractmethod
    def bounce(
        self, world: World, gbuffer: GBuffer, direct: NDArray[np.float32], made: Any, settings: Any, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Indirect light at every pixel, float32 (H, W, 3). direct: emission and direct light of the same pixels."""

    def direct(
        self, world: World, gbuffer: GBuffer, made: Any, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """Emission, background and direct light, float32 (H, W, 3)."""
        return direct_layer(world, gbuffer, settings, seed, counters)

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            from renderers.transport.raycast import caster_of

            caster_of(world)
            self.warm_up(world, settings)
        made = self.prepare(world, settings, context, counters)
        direct = np.zeros((context.size[1], context.size[0], 3), np.float64)
        indirect = np.zeros_like(direct)
        k, on_gl = settings.subpixels, settings.backend == "gl"
        for index in range(k * k):
            with timed(watch, "gbuffer", "render", on_gl):
                gbuffer = make_gbuffer(world, context.size, ((index % k + 0.5) / k, (index // k + 0.5) / k), settings.backend)
            with timed(watch, "direct", "render", settings.direct_visibility == "shadow-map"):
                lit = self.direct(world, gbuffer, made, settings, context.seed + (index << 32), counters)
            with timed(watch, self.pass_name, "render", on_gl):
                indirect += self.bounce(world, gbuffer, lit, made, settings, counters)
            direct += lit
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        layers = {"direct": (direct / k**2).astype(np.float32), "indirect": (indirect / k**2).astype(np.float32)}
        layers["beauty"] = layers["direct"] + layers["indirect"]
        return Frame(layers, watch.timings, dict(sorted(counters.items())), {"backend": settings.backend})
