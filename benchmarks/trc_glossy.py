"""Radiance records in time: glossy surfaces of `trc` against caches of each frame, with a path-traced truth.

Run: `python -m benchmarks.trc_glossy [--scene NAME]… [--frames A:B] [--spp N]`. Figures: docs/methods/trc.md.

`glossy-box` is `cube-in-a-box` with all its surfaces glossy. `per-frame` is `trc` with a fresh cache in every frame, `norm` and
`coefficients` with lives by either rate, `static` never renews a record, `diffuse` takes glossy surfaces for diffuse ones where
indirect light is reflected. Caches take turns frame by frame.

The truth is one bounce, by paths, in two independent halves of N a pixel, whose noise is taken out (`jobs.claims.trc_runs`). Errors
are of indirect light, RMS over its mean, in the last frames of the range; flicker is the RMS change of the error from frame to
frame, of pixels that see the same object. Times are of the render stage.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

import renderers
from jobs.claims.trc_runs import HALF_SEEDS, Ask, Truth, frame_errors, root_mean, runs_of, truth_of
from renderers.scene.model import Lambert, Phong, Scene
from service import parse

SIZE, WINDOW = (48, 36), 6
SHARED: dict[str, Any] = {"a": 0.2, "rays": 1024, "glossy_rays": 4096}
WAYS: dict[str, dict[str, Any]] = {
    "per-frame": {"cache": "per-frame"},
    "norm": {},
    "per-frame, records alone": {"cache": "per-frame", "glossy_pixels": 1},
    "norm, records alone": {"glossy_pixels": 1},
    "coefficients": {"glossy_rate": "coefficients"},
    "static": {"cache": "static"},
    "diffuse": {"glossy": "diffuse"},
}
SCENES = {"glossy-box": ((0, 19), 20), "bouncing-spheres": ((0, 9), 5), "interior": ((235, 249), 20)}  # frames, delta_max


def opened(name: str) -> Scene:
    """A scene of SCENES."""
    if name != "glossy-box":
        return renderers.load_scene(name)
    scene = renderers.load_scene("cube-in-a-box")
    albedos = {m.name: m.albedo for m in scene.materials if isinstance(m, Lambert)}
    glossy = (Phong(n, (0.5 * r, 0.5 * g, 0.5 * b), (0.4,) * 3, 20.0) for n, (r, g, b) in albedos.items())
    return replace(scene, materials=tuple(glossy))


def path_traced(scene: Scene, frames: range, spp: int) -> Truth:
    """The truth, of so many paths a pixel and half."""
    method, halves = renderers.get_method("pt"), []
    plain = truth_of(scene, SIZE, frames, rays=16)
    settings = method.Settings(transport="one-bounce", spp=spp)
    for seed in HALF_SEEDS:
        seen = [method.render(scene, settings, size=SIZE, frame=k, seed=seed).layers["beauty"] for k in frames]
        halves.append(np.array(seen, np.float64) - plain.direct)
    return replace(plain, halves=np.array(halves))


def main() -> None:
    """Render and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="default: all")
    parser.add_argument("--frames", help="A:B; default: by scene")
    parser.add_argument("--spp", type=int, default=2048)
    arguments = parser.parse_args()
    for name in arguments.scene or SCENES:
        frames, longest = SCENES[name]
        frames = parse.frames(arguments.frames) if arguments.frames else frames
        measure(name, frames, longest, arguments.spp)


def measure(name: str, frames: tuple[int, int], longest: int, spp: int) -> None:
    """One scene."""
    scene = opened(name)
    truth = path_traced(scene, range(max(frames[0], frames[1] + 1 - WINDOW), frames[1] + 1), spp)
    print(f"{name}: noise of the truth {truth.noise:.4f}", flush=True)
    asks = {way: Ask("trc", {**SHARED, "delta_max": longest, **values}) for way, values in WAYS.items()}
    runs_of(scene, asks, SIZE, (frames[0], frames[0] + 1), Truth.none(SIZE))  # compiles
    for way, run in runs_of(scene, asks, SIZE, frames, truth).items():
        found = frame_errors(run.indirect, truth)
        steady = run.cpu[1:-1].sum()
        print(
            f"{way:24s} cpu {run.cpu.sum():7.2f} s, steady {steady:7.2f} s, rays {run.rays.sum() / 1e6:6.1f} M,"
            f" records {run.records.sum():6d}, error {root_mean(found.error):.4f}, flicker {root_mean(found.change):.4f}",
            flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    main()
