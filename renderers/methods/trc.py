"""Temporal radiance caching (Gautron 2006, chapter 5): the records of radiance cache splatting live for several frames.

    τ      = E(t_k + 1) / E(t_k)                       foreseen from the same hemisphere, one frame ahead
    life_k = min(δ_max, ⌊a_t / |τ - 1|⌋ + 1)           frames that record k serves; then it is renewed in place, or deleted
    E_k(t) = E_k + ∇ᵗE (t - t_k)                       and likewise both spatial gradients

Glossy pixels have records of incoming radiance, as in `rcs`, whose coefficients and their gradients change in time likewise.

Passes of each frame: gbuffer, direct, lobes (those that no record holds), records (expired ones renewed, misses filled, splatted);
look-ahead: the successors of the last frames' records, in the range's last frame; splat: the second pass of interpolation, and
the light of glossy pixels.

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
| glossy_rate   | norm         |       | norm, coefficients               | what of a radiance record decides on its life        |
| guard         | true         |       |                                  | no foresight where lives stay at one frame           |
| stagger       | true         |       |                                  | records made together don't expire together          |
| follow        | true         |       |                                  | places on surfaces that move go with them            |
| backend       | auto         |       | auto, gl, cpu                    | where reprojected planes are drawn                   |
| a … subpixels |              |       |                                  | as `rcs`, with R from curvature and gradient           |
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame
from renderers.method import Claim, Context, SequenceMethod, Transport, register, setting
from renderers.methods.foresight import ahead_of, backend_of, prepare, samplers_of
from renderers.methods.ray_records import RecordSettings, chosen_placement, glossy_placement_of, placement_of, price_of
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.caching.reflectance import Gloss
    from renderers.transport.temporal.cache import Stage
    from renderers.transport.temporal.motion import Motion
    from renderers.transport.temporal.pending import Pending
    from renderers.transport.temporal.views import Look

    Float = NDArray[np.float64]

SOURCE, PLACEMENT = "Gautron 2006 §5", "Ward 1988; Křivánek et al. 2005; Schwarzhaupt et al. 2012"
COUNTED = (
    "pixels_covered", "pixels_missed", "predictions", "rays", "records", "records_ahead", "records_alive", "records_deleted",
    "records_kept", "records_new", "records_renewed", "splat_tests", "splats",
)  # fmt: skip
LEAST_RATE = 0.002  # per frame: median noise of rates foreseen from 4096 rays


class TrcSettings(RecordSettings):
    """Settings of temporal radiance caching."""

    a_t: float = setting(0.05, "relative change of light that a record may be used through", source=SOURCE + ".4.1", ge=1e-4, le=10)
    glossy_rate: Literal["norm", "coefficients"] = setting(
        "norm",
        "change of a radiance record: that of its coefficients as one function, or, if larger, that of any notable one of them",
        source="luxmeter",
    )
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
        "polar", "rays all over a hemisphere, or (irradiance alone) through one square plane", source="Gautron 2006 §4.2"
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
    """Direct light plus one bounce, interpolated between records that outlive their frame."""

    name = "trc"
    title = "Temporal radiance caching"
    source = "Gautron 2006 chapter 5"
    Settings = TrcSettings
    claims: ClassVar = {
        "diffuse": Claim("approximated", "indirect light is interpolated between records, within the accuracy a"),
        "glossy": Claim("approximated", "indirect light is interpolated between radiance records; sharper lobes are traced"),
        "specular": Claim("approximated", "lobes are traced by a few rays a pixel: noise"),
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
        """Fill in where planes are drawn and where records go."""
        chosen = {"backend": backend_of(settings.backend, device), "placement": chosen_placement(settings)}
        return settings.model_copy(update=chosen)

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
        from renderers.transport.temporal.cache import Policy
        from renderers.transport.temporal.layers import Layer
        from renderers.transport.temporal.views import DIFFUSE

        self.scene, self.settings, self.order = scene, settings, settings.harmonics
        mode = settings.gradients_in_time
        self.policy = Policy(
            settings.a_t,
            settings.delta_max,
            settings.cache,
            settings.guard,
            settings.stagger,
            frozen=mode == "none",
            follows=settings.follow and settings.cache == "temporal",
            curved=settings.lifespan == "chord" and mode == "interpolated",
        )
        self.interpolates = self.policy.foresees and mode == "interpolated" and bool(scene.channels)
        self.layers = {DIFFUSE: Layer(self.policy, self.interpolates)}
        self.motion: Motion | None = None
        self.changed = 0

    def built(self, context: Context, waiting: Sequence[Pending]) -> Pending:
        """The next frame's records and all else that is needed to draw it; earlier frames get the successors they wait for."""
        from renderers.transport.temporal.pending import Pending
        from renderers.transport.temporal.views import alone_of, direct_of, gbuffers_of, looks_of, traced_of

        counters, watch, settings = Counter(dict.fromkeys(COUNTED, 0)), context.watch, self.settings
        if self.motion is None:
            with watch("warm-up", "prepare"):
                prepare(self.scene.world(context.frame), settings)
        with watch("scene"):
            world = self._goes_to(context.frame)
        with watch("warm-up", "prepare"):
            gloss = self._gloss(world)
        with watch("gbuffer"):
            gbuffers = gbuffers_of(world, context.size, settings.subpixels)
            looks = [looks_of(world, gbuffer, gloss, price_of(settings)) for gbuffer in gbuffers]
        with watch("direct"):
            direct = direct_of(world, gbuffers, settings.light_samples, context.seed, counters)
        with watch("lobes"):
            traced = traced_of(world, gbuffers, gloss, settings.lobe_rays, context.seed, counters)
        shares = {}
        with watch("records"):
            for name, layer in self.layers.items():
                earlier = [frame.shares[name] for frame in waiting if name in frame.shares]
                stage = self._stage(name, context, counters)
                shares[name] = layer.share(stage, [look[name] for look in looks], earlier, counters)
        with watch("lobes"):
            alone = alone_of(world, gbuffers, looks, gloss, price_of(settings), context.seed, counters)
        return Pending(context, shares, direct, traced, alone, counters, world.camera, gbuffers[0].position, gloss)

    def look_ahead(self, context: Context, waiting: Sequence[Pending]) -> None:
        """One frame past the range: successors of the records that live in its last frames, and nothing else."""
        counters = Counter[str]()
        with context.watch("look-ahead"):
            world = self._goes_to(self.frame + 1)
            for name, layer in self.layers.items():
                earlier = [frame.shares[name] for frame in waiting if name in frame.shares]
                stage = self._stage(name, context, counters)
                layer.look_ahead(stage, context.frame, partial(self._looks, world, context.size, name), earlier)
        waiting[-1].counters["rays"] += counters["rays"]
        waiting[-1].counters["records_ahead"] += counters["records"]

    def drawn(self, waiting: Pending) -> Frame:
        """The picture of a frame."""
        settings = self.settings
        return waiting.drawn(self.interpolates, settings.delta_max, settings.lobe_rays, self.notes)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a result has to say about lives longer than hemispheres can foresee."""
        if self.settings.cache != "temporal" or self.settings.a_t / self.settings.delta_max >= LEAST_RATE:
            return ()
        return (
            f"a_t / delta_max is below {LEAST_RATE:.1%} a frame, the noise of a foreseen change: the longest lives mean little",
        )

    def _goes_to(self, frame: int) -> World:
        """Go to a frame: its World, and what happens between it and the next one."""
        from renderers.transport.temporal.motion import motion_between

        self.frame, self.past = frame, self.motion
        foresees = self.policy.foresees
        if self.motion is None or not self.motion.still or not foresees:
            self.changed = frame
        world = self.motion.after if self.motion is not None and foresees else self.scene.world(frame)
        if self.policy.follows and self.past is not None and not foresees:
            self.past = motion_between(self.past.before, world)
        # without foresight nobody asks what comes next
        self.motion = motion_between(world, self.scene.world(frame + 1) if foresees else world)
        return world

    def _gloss(self, world: World) -> Gloss | None:
        """What is glossy in a World, if radiance records are to hold it; the first that they hold decides their order."""
        from renderers.transport.caching.glossy import warm_up as prepare_turns
        from renderers.transport.caching.reflectance import gloss_of
        from renderers.transport.temporal.layers import Layer
        from renderers.transport.temporal.views import GLOSSY

        if self.settings.glossy == "diffuse":
            return None
        gloss = gloss_of(world, self.order, self.settings.sharp == "truncated")
        if gloss.order and GLOSSY not in self.layers:
            prepare_turns(gloss.order)
            self.order = gloss.order
            policy = replace(self.policy, together=self.settings.glossy_rate == "norm")
            self.layers[GLOSSY] = Layer(policy, self.interpolates)
        return gloss if gloss.shiny or GLOSSY in self.layers else None

    def _stage(self, name: str, context: Context, counters: Counter[str]) -> Stage:
        """What a layer needs of the frame that the run is at."""
        from renderers.transport.temporal.cache import Stage
        from renderers.transport.temporal.views import GLOSSY

        assert self.motion is not None
        settings, world, glossy = self.settings, self.motion.before, name == GLOSSY
        sampler, pilot = samplers_of(world, settings, context.seed, counters, self.order if glossy else None)
        ahead = ahead_of(self.motion, sampler, settings)
        place = glossy_placement_of if glossy else placement_of
        still = self.policy.foresees and self.motion.still
        placement = place(world, context.size[1], settings, context.seed)
        return Stage(self.frame, sampler, pilot, ahead, placement, still, self.changed, self.past)

    def _looks(self, world: World, size: tuple[int, int], name: str) -> list[Look]:
        from renderers.transport.temporal.views import gbuffers_of, looks_of

        gloss, price = self._gloss(world), price_of(self.settings)
        return [looks_of(world, gbuffer, gloss, price)[name] for gbuffer in gbuffers_of(world, size, self.settings.subpixels)]


register(TemporalRadianceCaching)
