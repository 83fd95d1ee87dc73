"""Temporal radiance caching (Gautron 2006, chapter 5): the records of radiance cache splatting live for several frames.

    τ      = E(t_k + 1) / E(t_k)                       foreseen from the same hemisphere, one frame ahead
    life_k = min(δ_max, ⌊a_t / |τ - 1|⌋ + 1)           frames that record k serves; then it is renewed in place, or deleted
    E_k(t) = E_k + ∇ᵗE (t - t_k)                       and likewise both spatial gradients

Passes of each frame: gbuffer, records (expired ones renewed, misses filled, splatted), direct; look-ahead: the successors of the
last frames' records, in the range's last frame; splat: the second pass of `gradients=interpolated`.

| setting       | default      | unit  | range                            | meaning                                              |
| ------------- | ------------ | ----- | -------------------------------- | ---------------------------------------------------- |
| a_t           | 0.05         | 1     | 10⁻⁴ … 10                        | relative change that a record may be used through    |
| delta_max     | 20           | frame | 1 … 1000                         | longest life                                         |
| lifespan      | chord        |       | rate, chord                      | lives by the change of light, or by its curvature too |
| gradients_in_time | interpolated |   | none, extrapolated, interpolated | ∇ᵗ                                                   |
| sampler       | polar        |       | polar, plane                     | rays all over a hemisphere, or through one plane      |
| prediction    | raycast      |       | raycast, reproject               | how the next frame is foreseen                       |
| footprints    | 4            | 1     | 1 … 8                            | points a side that a reprojected hit covers          |
| sparse        | 4            | 1     | 1 … 64                           | one ray in so many is foreseen where all change      |
| cache         | temporal     |       | temporal, per-frame, static      | renewed by lifespan, every frame, never              |
| guard         | true         |       |                                  | no foresight where lives stay at one frame           |
| stagger       | true         |       |                                  | records made together don't expire together          |
| follow        | true         |       |                                  | places on surfaces that move go with them            |
| backend       | auto         |       | auto, gl, cpu                    | where reprojected planes are drawn                   |
| a … subpixels |              |       |                                  | as `rcs`, with R from curvature and gradient           |
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame
from renderers.method import Claim, Context, SequenceMethod, Transport, register, setting
from renderers.methods.foresight import ahead_of, backend_of, samplers_of
from renderers.methods.ray_records import RecordSettings, albedos, placement_of, warm_up
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.temporal.cache import Stage, View
    from renderers.transport.temporal.motion import Motion
    from renderers.transport.temporal.pending import Pending

    Float = NDArray[np.float64]

SOURCE, PLACEMENT = "Gautron 2006 §5", "Ward 1988; Křivánek et al. 2005; Schwarzhaupt et al. 2012"
COUNTED = (
    "pixels_covered", "pixels_missed", "predictions", "rays", "records", "records_ahead", "records_alive", "records_deleted",
    "records_kept", "records_new", "records_renewed", "splat_tests", "splats",
)  # fmt: skip
CAPTION = "records of this frame; red: lives one frame, yellow: half as long as delta_max, green: delta_max frames"
LEAST_RATE = 0.002  # per frame: median noise of rates foreseen from 4096 rays


class TrcSettings(RecordSettings):
    """Settings of temporal radiance caching."""

    a_t: float = setting(0.05, "relative change of light that a record may be used through", source=SOURCE + ".4.1", ge=1e-4, le=10)
    delta_max: int = setting(20, "longest life of a record", unit="frame", source=SOURCE + ".4.1", ge=1, le=1000)
    lifespan: Literal["rate", "chord"] = setting(
        "chord",
        "lives end where the change foreseen reaches a_t, or, where records are interpolated in time, the error of that does",
        source=SOURCE + ".4.1; luxmeter",
    )
    gradients_in_time: Literal["none", "extrapolated", "interpolated"] = setting(
        "interpolated", "records frozen, extrapolated in time, or interpolated towards their successors", source=SOURCE + ".4.3"
    )
    sampler: Literal["polar", "plane"] = setting(
        "polar", "rays all over a hemisphere, or, as published, through one square plane", source="Gautron 2006 §4.2"
    )
    prediction: Literal["raycast", "reproject"] = setting(
        "raycast", "the next frame's hemisphere: cast anew where something moved, or reprojected", source=SOURCE + ".4.2"
    )
    footprints: int = setting(
        4, "points a side that a reprojected hit of a polar hemisphere covers; 1, as on planes: as published", ge=1, le=8
    )
    sparse: int = setting(
        4, "where a whole hemisphere changes, one ray in so many is foreseen; 1: all of them", source="luxmeter", ge=1, le=64
    )
    cache: Literal["temporal", "per-frame", "static"] = setting(
        "temporal", "records are renewed by their lifespans, computed in every frame, or kept for ever", source=SOURCE + ".6"
    )
    guard: bool = setting(True, "places whose records live for one frame are foreseen more and more seldom")
    stagger: bool = setting(True, "first lives are cut, so that records made together don't expire together")
    follow: bool = setting(True, "places on surfaces that move go with them; off, as published: all stay where they were made")
    backend: Literal["auto", "gl", "cpu"] = setting(
        "auto", "where reprojected planes are drawn; auto: by a table on the device string", source=SOURCE + ".4.2"
    )
    placement: Literal["auto", "split-sphere", "bounded", "hessian", "hessian-bounded"] = setting(
        "auto", "R from distances or from the curvature of the irradiance, limited by its gradient or not", source=PLACEMENT
    )

    @property
    def neighbours(self) -> bool:
        """Neighbour clamping is not offered: radii would depend on records of later frames."""
        return False

    @property
    def by_curvature(self) -> str:
        """The gradient limits radii too: without it hot spots near what moves are extrapolated wildly until renewal."""
        return "hessian-bounded"


class TemporalRadianceCaching(SequenceMethod):
    """Direct light plus one diffuse bounce, interpolated between records that outlive their frame."""

    name = "trc"
    title = "Temporal radiance caching"
    source = "Gautron 2006 chapter 5"
    Settings = TrcSettings
    claims: ClassVar = {
        "diffuse": Claim("approximated", "indirect light is interpolated between records, within the accuracy a"),
        "glossy": Claim("approximated", "indirect light is reflected as by a diffuse surface of the same mean albedo"),
        "specular": Claim("approximated", "indirect light is reflected as by a diffuse surface of the same mean albedo"),
        "animated_geometry": Claim(
            "approximated", "indirect light may lag by a_t, and by up to delta_max frames after a sudden change"
        ),
        "animated_light": Claim(
            "approximated", "indirect light may lag by a_t, and by up to delta_max frames after a sudden change"
        ),
    }

    def transport(self, settings: Any) -> Transport:
        """One bounce, both visibilities."""
        return "one-bounce"

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Fill in where planes are drawn."""
        return settings.model_copy(update={"backend": backend_of(settings.backend, device)})

    def _render_frames(self, scene: Scene, settings: Any, contexts: Iterable[Context]) -> Iterator[Frame]:
        """Frames one after the other; interpolation holds them back until their records' successors are known."""
        run = _Run(scene, settings)
        waiting: deque[Pending] = deque()
        context: Context | None = None
        for context in contexts:
            waiting.append(run.built(context, waiting))
            while waiting and waiting[0].settled:
                yield run.drawn(waiting.popleft())
        while waiting and context is not None:
            run.look_ahead(context, waiting)
            while waiting and waiting[0].settled:
                yield run.drawn(waiting.popleft())


class _Run:
    """One run through an animation: the cache, and where in time it is."""

    def __init__(self, scene: Scene, settings: Any) -> None:
        from renderers.transport.temporal.cache import Policy, TemporalCache

        self.scene, self.settings = scene, settings
        mode = settings.gradients_in_time
        self.policy = Policy(
            settings.a_t, settings.delta_max, settings.cache, settings.guard, settings.stagger,
            frozen=mode == "none", follows=settings.follow and settings.cache == "temporal",
            curved=settings.lifespan == "chord" and mode == "interpolated",
        )  # fmt: skip
        self.cache = TemporalCache(self.policy)
        self.interpolates = self.policy.foresees and mode == "interpolated" and bool(scene.channels)
        self.motion: Motion | None = None
        self.changed = 0

    def built(self, context: Context, waiting: Iterable[Pending]) -> Pending:
        """The next frame's records and all else that is needed to draw it; earlier frames get the successors they wait for."""
        from renderers.transport.temporal.pending import Pending, hand_over

        counters, watch = Counter(dict.fromkeys(COUNTED, 0)), context.watch
        if self.motion is None:
            with watch("warm-up", "prepare"):
                warm_up(self.scene.world(context.frame))
        with watch("scene"):
            stage = self._stage(context.frame, context, counters)
        views, albedo, direct, position = self._seen(context, counters)
        with watch("records"):
            renewed = self.cache.step(stage, views, counters)
        hand_over(waiting, renewed, context.frame)
        live = self.cache.live
        # a record of one frame has no trend to wait for
        unsettled = (live.life > 1) & self.interpolates
        return Pending(context, views, albedo, direct, live, unsettled, counters, stage.sampler.world.camera, position)

    def look_ahead(self, context: Context, waiting: Sequence[Pending]) -> None:
        """One frame past the range: successors of the records that live in its last frames, and nothing else."""
        from renderers.transport.temporal.cache import cover
        from renderers.transport.temporal.pending import hand_over

        frame, counters = self.frame + 1, Counter[str]()
        with context.watch("look-ahead"):
            live = self.cache.live
            self.cache.live = live.rows((live.born <= context.frame) & (live.life > 1))
            stage = self._stage(frame, context, counters)._replace(ahead=None)
            renewed = self.cache.renew(stage, Counter())
            hand_over(waiting, renewed, frame)
            live = self.cache.live
            self.cache.live = live.rows(live.born <= context.frame)
            if (self.cache.live.last == frame).any() and self.motion is not None:
                views = [view for view, _ in self._views(self.motion.before, context.size)]
                self.cache.live = cover(self.cache.live, stage, views)
        waiting[-1].counters["rays"] += counters["rays"]
        waiting[-1].counters["records_ahead"] += counters["records"]

    def drawn(self, waiting: Pending) -> Frame:
        """The picture of a frame."""
        from renderers.transport.temporal.overlay import overlay

        settings, context, counters = self.settings, waiting.context, waiting.counters
        width, height = context.size
        indirect = np.zeros((height * width, 3))
        with context.watch("splat"):
            for view, albedo in zip(waiting.views, waiting.albedo, strict=True):
                canvas = view.canvas
                if self.interpolates:
                    canvas.clear()
                    values = waiting.records.at(context.frame)
                    canvas.add(values, settings.a, settings.weight, settings.gradients, counters)
                indirect[canvas.rows] += canvas.irradiance * albedo / np.pi
                counters["pixels_missed"] += int(np.count_nonzero(canvas.missed))
        count = len(waiting.views)
        layers = {"direct": waiting.direct / count, "indirect": indirect.reshape(height, width, 3) / count}
        images = {name: layer.astype(np.float32) for name, layer in layers.items()}
        images["beauty"] = images["direct"] + images["indirect"]
        timings = context.watch.timings
        images["debug.records"] = overlay(
            waiting.records, self.settings.delta_max, waiting.camera, waiting.position, images["indirect"]
        )
        return Frame(images, timings, dict(sorted(counters.items())), notes=self.notes, captions={"debug.records": CAPTION})

    @property
    def notes(self) -> tuple[str, ...]:
        """What a result has to say about lives longer than hemispheres can foresee."""
        if self.settings.cache != "temporal" or self.settings.a_t / self.settings.delta_max >= LEAST_RATE:
            return ()
        return (
            f"a_t / delta_max is below {LEAST_RATE:.1%} a frame, the noise of a foreseen change: the longest lives mean little",
        )

    def _stage(self, frame: int, context: Context, counters: Counter[str]) -> Stage:
        """Go to a frame: its World, and what happens between it and the next one."""
        from renderers.transport.temporal.cache import Stage
        from renderers.transport.temporal.motion import motion_between

        self.frame = frame
        foresees = self.policy.foresees
        if self.motion is None or not self.motion.still or not foresees:
            self.changed = frame
        world = self.motion.after if self.motion is not None and foresees else self.scene.world(frame)
        past = self.motion
        if self.policy.follows and past is not None and not foresees:
            past = motion_between(past.before, world)
        # without foresight nobody asks what comes next
        self.motion = motion_between(world, self.scene.world(frame + 1) if foresees else world)
        sampler, pilot = samplers_of(world, self.settings, context.seed, counters)
        placement = placement_of(world, context.size[1], self.settings, context.seed)
        ahead = ahead_of(self.motion, sampler, self.settings)
        return Stage(frame, sampler, pilot, ahead, placement, foresees and self.motion.still, self.changed, past)

    def _seen(self, context: Context, counters: Counter[str]) -> tuple[list[View], list[Float], Float, NDArray[np.float32]]:
        """Views, the albedo (P, 3) of their pixels, all views' direct light (H, W, 3) summed, positions (H, W, 3) of the first."""
        from renderers.transport.direct import direct, emitted

        assert self.motion is not None
        world, watch = self.motion.before, context.watch
        views, albedo, total = [], [], np.zeros((context.size[1], context.size[0], 3))
        with watch("gbuffer"):
            seen = self._views(world, context.size)
        for index, (view, gbuffer) in enumerate(seen):
            views.append(view)
            albedo.append(albedos(world, gbuffer).reshape(-1, 3)[view.canvas.rows])
            with watch("direct"):
                seed = context.seed + (index << 32)
                samples = self.settings.light_samples
                total += emitted(world, gbuffer) + direct(world, gbuffer, samples, seed, counters=counters)
            counters["pixels_covered"] += int(np.count_nonzero(gbuffer.covered))
        return views, albedo, total, seen[0][1].position

    def _views(self, world: World, size: tuple[int, int]) -> list[tuple[View, GBuffer]]:
        """Views of all sub-pixels."""
        from renderers.transport.caching.records import Sites
        from renderers.transport.caching.splat import Canvas
        from renderers.transport.direct import receivers_of
        from renderers.transport.primary import cast_gbuffer
        from renderers.transport.temporal.cache import View

        views, k = [], self.settings.subpixels
        for index in range(k * k):
            gbuffer = cast_gbuffer(world, size, ((index % k + 0.5) / k, (index // k + 0.5) / k))
            canvas = Canvas.of(gbuffer, albedos(world, gbuffer).max(axis=2) > 0)
            views.append((View(canvas, Sites(*receivers_of(world, gbuffer, canvas.rows))), gbuffer))
        return views


register(TemporalRadianceCaching)
