"""Sequences of temporal caching and of its peers, their truth, and what is measured: shared by claims and benchmarks.

The truth is one bounce of light by hemispheres at every pixel, with the same random numbers in every frame: what `trc`
would give without interpolation, in space or in time. Like `glossy=diffuse` it takes surfaces for diffuse where indirect light is
reflected.

It has noise, which would count as error of whatever is compared with it. So it is made in two independent halves t₁ and t₂ of mean
t: as E[(m − t₁)(m − t₂)] = (m − t)², squared errors are products of the differences from both, free of bias. (m − t̄)² of
their mean t̄ less its variance, estimated by (t₁ − t₂)² / 4, is the same number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers import Scene, get_method
from renderers.frame import Frame

# rays a pixel of each half
REFERENCE_RAYS = 1024
HALF_SEEDS = (1, 2)
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
COUNTED = ("rays", "records", "records_alive")


@dataclass(frozen=True)
class Truth:
    """Of K frames `frames`: independent halves of indirect light (2, K, H, W, 3) and direct light (K, H, W, 3); revealed (K, H, W):
    what a moving object hid until lately; seen int32 (K, H, W): number of the object in a pixel, -1 where there is none."""

    frames: tuple[int, ...]
    halves: F64
    direct: F64
    revealed: NDArray[np.bool_]
    seen: NDArray[np.int32]

    @staticmethod
    def none(size: tuple[int, int]) -> Truth:
        """Of no frames: no picture is kept, only times and counts."""
        nothing = np.zeros((0, size[1], size[0], 3))
        return Truth(
            (), np.array([nothing, nothing]), nothing, np.zeros(nothing.shape[:3], bool), np.zeros(nothing.shape[:3], np.int32)
        )

    @cached_property
    def indirect(self) -> F64:
        """Mean of both halves (K, H, W, 3)."""
        return np.asarray(self.halves.mean(axis=0))

    @property
    def noise(self) -> float:
        """RMS error of that mean, over the mean of all frames."""
        return float(np.sqrt(np.mean((self.halves[0] - self.halves[1]) ** 2)) / 2 / self.indirect.mean())

    def steady(self, k: int) -> NDArray[np.bool_] | None:
        """Pixels (H, W) that see the same object in frame k of them and the one before; None where that is not among them."""
        if k < 1 or self.frames[k - 1] != self.frames[k] - 1:
            return None
        return np.asarray(self.seen[k] == self.seen[k - 1])


class Run(NamedTuple):
    """What a method gave: indirect light of the truth's frames (K, H, W, 3), and of all N frames, (N,) each, seconds and counts."""

    indirect: F64
    cpu: F64
    wall: F64
    rays: I64
    records: I64
    alive: I64


class Ask(NamedTuple):
    """A method and its settings."""

    method: str
    values: dict[str, Any]


def runs_of(scene: Scene, asks: Mapping[str, Ask], size: tuple[int, int], frames: tuple[int, int], truth: Truth) -> dict[str, Run]:
    """Render frames A … B with all methods, each from its own copy of the scene; pictures of the truth's frames are kept.

    They take turns frame by frame, so that what else the machine does meets all alike: CPU seconds too depend on it.
    """
    found: dict[str, _Collected] = {name: _Collected([], []) for name in asks}
    streams = {name: _frames(scene, ask, size, frames) for name, ask in asks.items()}
    for number in range(frames[0], frames[1] + 1):
        for name, stream in streams.items():
            found[name].take(next(stream), number, truth)
    return {name: collected.run(truth) for name, collected in found.items()}


def _frames(scene: Scene, ask: Ask, size: tuple[int, int], frames: tuple[int, int]) -> Iterator[Frame]:
    method = get_method(ask.method)
    return method.render_frames(replace(scene), method.Settings(**ask.values), size=size, frames=frames)


class _Collected(NamedTuple):
    pictures: list[F64]
    rows: list[tuple[float, ...]]

    def take(self, frame: Frame, number: int, truth: Truth) -> None:
        """Frame `number` of the run."""
        if number in truth.frames:
            self.pictures.append(_indirect(frame, truth.direct[truth.frames.index(number)]))
        spent = [(t.cpu_s, t.wall_s) for t in frame.timings if t.stage == "render"]
        rays, *others = (frame.counters.get(name, 0) for name in COUNTED)
        self.rows.append((*np.sum(spent, axis=0), rays + frame.counters.get("lobe_rays", 0), *others))

    def run(self, truth: Truth) -> Run:
        """All of it."""
        cpu, wall, *counts = np.array(self.rows).T
        rays, records, alive = (column.astype(np.int64) for column in counts)
        return Run(np.array(self.pictures, np.float64).reshape(truth.indirect.shape), cpu, wall, rays, records, alive)


def _indirect(frame: Frame, direct: F64) -> F64:
    """Its layer, or, where there is none, the picture less the truth's direct light."""
    return frame.layers["indirect"].astype(np.float64) if "indirect" in frame.layers else frame.layers["beauty"] - direct


def truth_of(scene: Scene, size: tuple[int, int], frames: Sequence[int], rays: int = REFERENCE_RAYS) -> Truth:
    """Two hemispheres of so many rays at every pixel of some frames, ascending."""
    from renderers.methods.ray_records import albedos
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.records import Sites
    from renderers.transport.direct import direct, emitted, receivers_of
    from renderers.transport.primary import cast_gbuffer
    from renderers.transport.revealed import revealed

    shape = len(frames), size[1], size[0]
    halves, lit, hidden = np.zeros((2, *shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, bool)
    seen = np.full(shape, -1, np.int32)
    for number, frame in enumerate(frames):
        world = scene.world(frame)
        gbuffer = cast_gbuffer(world, size)
        rows = np.flatnonzero(gbuffer.covered)
        sites, albedo = Sites(*receivers_of(world, gbuffer, rows)), albedos(world, gbuffer).reshape(-1, 3)[rows]
        for half, seed in zip(halves, HALF_SEEDS, strict=True):
            sampler = PolarSampler(world, grid_of(rays), ReflectedDirectLight(world), seed)
            half[number].reshape(-1, 3)[rows] = sampler(sites).irradiance * albedo / np.pi
        seen[number].ravel()[rows] = world.instance[gbuffer.triangle.ravel()[rows]]
        lit[number] = emitted(world, gbuffer) + direct(world, gbuffer)
        shown = revealed(scene, frame, size)
        if shown is not None:
            hidden[number] = shown
    return Truth(tuple(frames), halves, lit, hidden, seen)


def accuracy(indirect: F64, truth: F64) -> F64:
    """Percent, of each frame: 100 (1 - mean relative error). Absolute values can't be rid of the truth's noise: it lowers them."""
    relative = np.abs(indirect - truth) / np.maximum(truth, 1e-3 * truth.mean())
    return np.asarray(100 * (1 - relative.mean(axis=(1, 2, 3))))


def accuracy_lost(indirect: F64, truth: Truth) -> F64:
    """Percentage points, of each frame, that noise of the truth's mean takes off `accuracy` at most.

    f(σ) = E|e + σz|, z of zero mean, is convex and doesn't fall for σ ≥ 0. The noise of a half is √2 times that of the mean, so
    f(σ) - f(0) ≤ (f(√2 σ) - f(σ)) / (√2 - 1).
    """
    single = (accuracy(indirect, truth.halves[0]) + accuracy(indirect, truth.halves[1])) / 2
    return np.asarray((accuracy(indirect, truth.indirect) - single) / (np.sqrt(2) - 1))


def squares(found: F64, halves: F64) -> F64:
    """Squared errors of values (…) against a truth in two independent halves (2, …), free of bias: one by one also below 0."""
    return np.asarray((found - halves[0]) * (found - halves[1]))


class FrameErrors(NamedTuple):
    """Of K frames, (K,) each, in units of the truth's mean over all of them.

    error: mean square; change: mean square of the error's change from the frame before, of pixels that see the same object in both,
    NaN where that frame is not among them. Both are free of the truth's noise, on average: by chance slightly below 0.
    jump: the greatest such change, which is of one pixel and holds the noise of the truth there.
    ghost: mean signed residual where a moving object hid the surface lately, NaN where none did.
    """

    error: F64
    change: F64
    jump: F64
    ghost: F64

    @property
    def rmse(self) -> F64:
        """RMS error."""
        return np.sqrt(np.maximum(self.error, 0))

    @property
    def flicker(self) -> F64:
        """RMS change of the error."""
        return np.sqrt(np.maximum(self.change, 0))


def frame_errors(indirect: F64, truth: Truth) -> FrameErrors:
    """Errors of each frame that has a truth; indirect (K, H, W, 3)."""
    unit = truth.indirect.mean()
    images, halves, residual = indirect / unit, truth.halves / unit, (indirect - truth.indirect) / unit
    found = np.full((4, len(truth.frames)), np.nan)
    found[0] = squares(images, halves).mean(axis=(1, 2, 3))
    for k in range(len(truth.frames)):
        steady = truth.steady(k)
        if steady is not None and steady.any():
            found[1, k] = squares(images[k] - images[k - 1], halves[:, k] - halves[:, k - 1])[steady].mean()
            found[2, k] = np.abs(residual[k] - residual[k - 1])[steady].max()
        if truth.revealed[k].any():
            found[3, k] = residual[k][truth.revealed[k]].mean()
    return FrameErrors(*found)


def root_mean(squared: F64) -> float:
    """Root of the mean over the frames that have a value, taken for 0 where that is below; NaN where no frame has."""
    known = squared[~np.isnan(squared)]
    return float(np.sqrt(max(known.mean(), 0.0))) if len(known) else float("nan")
