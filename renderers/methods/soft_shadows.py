"""What all methods share that know the hidden share of an area light: C = Σ_e C_e (1 - V_e), everything else ray cast.

Not a method of its own: `pdsm`, `averaged-shadow-maps`, `layered-attenuation-map`, `moment-shadow-map`, `pcss`, `shadow-map` and
`ray-cast-area-light` differ in V alone, so their images differ by nothing else. Punctual lights and the environment are ray cast,
exactly.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from renderers.frame import Frame
from renderers.method import Claim, Context, Method, Settings, Transport, setting
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.shading import F64, Hidden


class SoftShadowSettings(Settings):
    """Settings of every such method."""

    samples: int = setting(64, "N, points on each light", source="St-Amour 2004 §3.1", ge=1, le=4096)
    pattern: Literal["hammersley", "stratified"] = setting(
        "hammersley", "light points of rectangles and discs: shifted Hammersley set, or one in each stratum as published"
    )
    map_resolution: int = setting(256, "texels across a shadow map", unit="px", source="St-Amour 2004 §3.3", ge=8, le=4096)
    bias: float = setting(1e-3, "added to all stored depths, in scene radii", unit="r", source="St-Amour 2004 §3.1", ge=0, le=1)
    near: float = setting(1.0, "near plane's distance from the light, in half sizes of the light", ge=0.01, le=100)
    lights: int = setting(8, "brightest area lights so treated; the others are ray cast", ge=1, le=64)
    horizon: Literal["rays", "share"] = setting(
        "rays", "light partly behind a receiver's plane: shadow rays to what is before it, or V less the share behind"
    )
    light_samples: int = setting(64, "samples per pixel of the light without shadows, and of what is ray cast", ge=1, le=4096)


class SoftShadows(Method):
    """Direct light with a hidden share per area light; subclasses say where the share comes from."""

    how_area: ClassVar[str]
    # whether V counts the light points behind a receiver's plane, which its own surface hides
    horizon: ClassVar[bool] = True
    claims: ClassVar = {}

    def __init_subclass__(cls) -> None:
        cls.claims = {"area_light": Claim("approximated", cls.how_area)}

    def transport(self, settings: Any) -> Transport:
        """Direct light."""
        return "direct"

    @abstractmethod
    def warm_up(self) -> None:
        """Import and compile."""

    @abstractmethod
    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """Whatever is built once per frame, and the hidden share read from it. points: light points (N, 3) of each emitter."""

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, watch, counters = scene.world(context.frame), context.watch, Counter[str]()
        with watch("warm-up", "prepare"):
            from renderers.transport.penumbra.emitters import emitters_of
            from renderers.transport.penumbra.shading import shaded
            from renderers.transport.primary import cast_gbuffer
            from renderers.transport.raycast import caster_of

            caster_of(world)
            self.warm_up()
        with watch("maps", "prepare"):
            emitters = emitters_of(world)[: settings.lights]
            points = [e.points(settings.samples, context.seed, k, pattern=settings.pattern) for k, e in enumerate(emitters)]
            hidden = self.prepare(world, emitters, points, settings, counters)
        total = np.zeros((context.size[1], context.size[0], 3))
        k = settings.subpixels
        for index in range(k * k):
            with watch("gbuffer"):
                gbuffer = cast_gbuffer(world, context.size, ((index % k + 0.5) / k, (index // k + 0.5) / k))
            with watch("direct"):
                seed = context.seed + (index << 32)
                total += shaded(
                    world, gbuffer, emitters, points, hidden, settings.light_samples, seed, counters,
                    horizon=settings.horizon if self.horizon else "ignored",
                )  # fmt: skip
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        direct = (total / k**2).astype(np.float32)
        layers = {"direct": direct, "indirect": np.zeros_like(direct), "beauty": direct.copy()}
        return Frame(layers, watch.timings, dict(sorted(counters.items())))
