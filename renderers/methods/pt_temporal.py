"""Path tracing with a temporal accumulation filter: few paths a frame, averaged with the past of each surface point.

    L̄_t(p) = (1 - α) L̄_{t-1}(p') + α L_t(p),   α = max(1/n, alpha)

p' is where the pixel's surface point was one frame ago; n the frames it has been followed for. What filtering takes from the noise
it gives back as lag: light that changes on a surface that doesn't move is seen late.

| setting   | default | unit        | range        | meaning                                            |
| --------- | ------- | ----------- | ------------ | -------------------------------------------------- |
| spp       | 16      | paths/pixel | 1 … 2²⁰      | paths of each frame                                |
| alpha     | 0.1     | 1           | 10⁻³ … 1     | least weight of the new frame; 1: plain path tracing |
| transport | full    |             | as `pt`      | light paths that are traced                        |
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from renderers.frame import Frame
from renderers.method import Context, SequenceMethod, Settings, Transport, register, setting
from renderers.methods.pt import MOST_SPP, PathTracing, PathTracingSettings
from renderers.scene.model import Scene

if TYPE_CHECKING:
    from renderers.transport.temporal.accumulation import History

SOURCE = "Nehab et al. 2007; Karis 2014"


class PtTemporalSettings(Settings):
    """Settings of `pt-temporal`."""

    transport: Transport = setting("full", "light paths that are traced", source="Kajiya 1986")
    spp: int = setting(16, "paths a pixel in each frame", unit="paths/pixel", source="Kajiya 1986", ge=1, le=MOST_SPP)
    alpha: float = setting(0.1, "least weight of the new frame; 1: no filter", source=SOURCE, ge=1e-3, le=1)


class TemporalPathTracing(SequenceMethod):
    """Path-traced frames, each averaged with where its surfaces were."""

    name = "pt-temporal"
    title = "Path tracing with temporal accumulation"
    source = SOURCE
    Settings = PtTemporalSettings
    claims: ClassVar = {}

    def transport(self, settings: Any) -> Transport:
        """The transport that was asked for."""
        transport: Transport = settings.transport
        return transport

    def _render_frames(self, scene: Scene, settings: Any, contexts: Iterable[Context]) -> Iterator[Frame]:
        """Frame by frame: path-traced with numbers of its own, then filtered."""
        from renderers.transport.primary import cast_gbuffer
        from renderers.transport.temporal.accumulation import accumulated

        past: History | None = None
        paths = PathTracingSettings(transport=settings.transport, spp=settings.spp, subpixels=settings.subpixels)
        for context in contexts:
            traced = PathTracing()._render(scene, paths, context)
            world = scene.world(context.frame)
            with context.watch("gbuffer"):
                gbuffer = cast_gbuffer(world, context.size)
            with context.watch("filter"):
                past = accumulated(traced.layers["beauty"], world, gbuffer, past, settings.alpha)
            kept = int(np.count_nonzero(past.age > 1))
            counters = {**traced.counters, "pixels_followed": kept, "pixels_covered": int(gbuffer.covered.sum())}
            yield Frame({"beauty": past.mean.astype(np.float32)}, context.watch.timings, counters, device=traced.device)


register(TemporalPathTracing)
