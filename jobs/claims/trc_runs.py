"""Sequences of temporal caching and of its peers, their truth, and what is measured: shared by claims and benchmarks.

The truth is one bounce of light by a hemisphere at every pixel, with the same random numbers in every frame: what `trc`
would give without interpolation, in space or in time. Like `glossy=diffuse` it takes surfaces for diffuse where indirect light is
reflected.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers import Scene, get_method
from renderers.frame import Frame

REFERENCE_RAYS = 1024
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
COUNTED = ("rays", "records", "records_alive")


@dataclass(frozen=True)
class Truth:
    """Of K frames `frames`: indirect and direct light (K, H, W, 3); revealed (K, H, W): what a moving object hid until lately;
    seen int32 (K, H, W): number of the object in a pixel, -1 where there is none."""

    frames: tuple[int, ...]
    indirect: F64
    direct: F64
    revealed: NDArray[np.bool_]
    seen: NDArray[np.int32]

    @staticmethod
    def none(size: tuple[int, int]) -> Truth:
        """Of no frames: no picture is kept, only times and counts."""
        nothing = np.zeros((0, size[1], size[0], 3))
        return Truth((), nothing, nothing, np.zeros(nothing.shape[:3], bool), np.zeros(nothing.shape[:3], np.int32))

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
    """Hemispheres at every pixel of some frames, ascending."""
    from renderers.methods.ray_records import albedos
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.records import Sites
    from renderers.transport.direct import direct, emitted, receivers_of
    from renderers.transport.primary import cast_gbuffer
    from renderers.transport.revealed import revealed

    shape = len(frames), size[1], size[0]
    images, lit, hidden = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, bool)
    seen = np.full(shape, -1, np.int32)
    for number, frame in enumerate(frames):
        world = scene.world(frame)
        gbuffer = cast_gbuffer(world, size)
        rows = np.flatnonzero(gbuffer.covered)
        sampler = PolarSampler(world, grid_of(rays), ReflectedDirectLight(world), seed=1)
        irradiance = sampler(Sites(*receivers_of(world, gbuffer, rows))).irradiance
        images[number].reshape(-1, 3)[rows] = irradiance * albedos(world, gbuffer).reshape(-1, 3)[rows] / np.pi
        seen[number].ravel()[rows] = world.instance[gbuffer.triangle.ravel()[rows]]
        lit[number] = emitted(world, gbuffer) + direct(world, gbuffer)
        shown = revealed(scene, frame, size)
        if shown is not None:
            hidden[number] = shown
    return Truth(tuple(frames), images, lit, hidden, seen)


def rmse(indirect: F64, truth: F64) -> float:
    """RMS error over the mean of the truth."""
    return float(np.sqrt(np.mean((indirect - truth) ** 2)) / truth.mean())


def accuracy(indirect: F64, truth: F64) -> F64:
    """Percent, of each frame: 100 (1 - mean relative error)."""
    relative = np.abs(indirect - truth) / np.maximum(truth, 1e-3 * truth.mean())
    return np.asarray(100 * (1 - relative.mean(axis=(1, 2, 3))))


class FrameErrors(NamedTuple):
    """Of K frames, (K,) each, in units of the truth's mean over all of them: RMS error; RMS of the error's change from the frame
    before and the greatest such change, of pixels that see the same object in both, NaN where that frame is not among them; mean
    signed residual where a moving object hid the surface lately, NaN where none did."""

    rmse: F64
    flicker: F64
    jump: F64
    ghost: F64


def frame_errors(indirect: F64, truth: Truth) -> FrameErrors:
    """Errors of each frame that has a truth; indirect (K, H, W, 3)."""
    error = (indirect - truth.indirect) / truth.indirect.mean()
    found = np.full((4, len(truth.frames)), np.nan)
    found[0] = np.sqrt(np.mean(error**2, axis=(1, 2, 3)))
    for k in range(len(truth.frames)):
        steady = truth.steady(k)
        if steady is not None and steady.any():
            change = (error[k] - error[k - 1])[steady]
            found[1, k], found[2, k] = np.sqrt(np.mean(change**2)), np.abs(change).max()
        if truth.revealed[k].any():
            found[3, k] = error[k][truth.revealed[k]].mean()
    return FrameErrors(*found)


def over_all(values: F64) -> float:
    """Root mean square over the frames that have a value; NaN where none has."""
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
