"""Chapter 5 of Gautron 2006: temporal caching against caches of each frame, on five scenes, over time, and in memory.

Image size, accuracy and times belong to a machine of 2006; ratios are compared, and both sides are measured in one run. The
baseline is the same program with `cache=per-frame`. The published scenes can't be shipped; built-in ones of the same description
take their places, and a part of a sequence that of the whole where the whole would take too long.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from jobs.claims.bench import Bench
from jobs.claims.model import Measurement, PublishedClaim, Row, held, row
from jobs.claims.registry import register
from jobs.claims.trc_runs import (
    REFERENCE_RAYS,
    Ask,
    Run,
    Truth,
    accuracy,
    accuracy_lost,
    frame_errors,
    root_mean,
    runs_of,
    squares,
    truth_of,
)
from renderers import Scene

SOURCE = "Gautron 2006"
SIZE = (96, 72)
# rays a record: published are 64 x 64
A, RAYS = 0.2, 4096
# Consecutive frames that errors and flicker are taken from
WINDOW = 10


class Case(NamedTuple):
    """One published scene: frames A … B rendered (of how many), δ_max, published speed-up."""

    frames: tuple[int, int]
    whole: int
    longest: int
    speedup: float


# the interior's light moves in 20 of its 60 frames, as it does in a third of the published sequence
CASES = {
    "cube-in-a-box": Case((0, 399), 400, 20, 7.62),
    "moving-light": Case((0, 99), 400, 20, 0.95),
    "kite": Case((0, 99), 300, 20, 6.52),
    "interior": Case((230, 289), 750, 20, 1.9),
    "bouncing-spheres": Case((0, 39), 200, 5, 4.24),
}
MODES = ("none", "extrapolated", "interpolated")
# records made together live for `delta_max` frames, whatever the light does
ALIKE: dict[str, Any] = {"stagger": False, "a_t": 10, "guard": False}


def temporal(bench: Bench, scene: Scene, frames: tuple[int, int], truth: Truth, **ways: dict[str, Any]) -> dict[str, Run]:
    """Frames A … B by `trc` in several ways, which take turns; glossy surfaces are diffuse ones, as in the truth."""
    bench.report(f"{scene.name}: trc, frames {frames[0]}:{frames[1]}, {ways}")
    asks = {name: Ask("trc", {"a": A, "rays": RAYS, "glossy": "diffuse", **values}) for name, values in ways.items()}
    return runs_of(scene, asks, SIZE, frames, truth)


def exact(bench: Bench, scene: Scene, frames: Sequence[int]) -> Truth:
    """Hemispheres at every pixel."""
    bench.report(f"{scene.name}: hemispheres at every pixel, {len(frames)} frames")
    return truth_of(scene, SIZE, frames)


def five_scenes(bench: Bench) -> Measurement:
    """Table 5.2: speed-up of each scene, with the records and the flicker behind it."""
    rows: list[Row] = []
    for name, case in CASES.items():
        rows += scene_rows(bench, name, case)
    parts = ", ".join(f"{name} {case.frames[0]}:{case.frames[1]} of {case.whole}" for name, case in CASES.items())
    notes = [
        f"{SIZE[0]}x{SIZE[1]} pixels, a = {A}, {RAYS} rays a record, interpolated gradients, frames rendered: {parts}",
        "speed-up: CPU seconds of all passes, the baseline's over temporal caching's, direct light included",
        "published times are those of a machine of 2006 with larger pictures; flicker isn't published",
        f"errors and flicker: {WINDOW} frames in the middle, against two hemispheres of {REFERENCE_RAYS} rays at every pixel; "
        "their noise is taken out: squares are products of the differences from both",
        "flicker: of pixels that see the same object as in the frame before",
    ]
    return Measurement("built-in scenes in place of the published ones", rows, notes)


def scene_rows(bench: Bench, name: str, case: Case) -> list[Row]:
    """Rows of one scene."""
    scene = bench.open(name).scene
    middle = (case.frames[0] + case.frames[1] + 1) // 2
    truth = exact(bench, scene, range(middle - WINDOW // 2, middle + WINDOW // 2))
    ways: dict[str, dict[str, Any]] = {"plain": {"cache": "per-frame"}, "kept": {"delta_max": case.longest}}
    temporal(bench, scene, (0, 1), Truth.none(SIZE), **ways)  # compiles
    plain, kept = temporal(bench, scene, case.frames, truth, **ways).values()
    found = [frame_errors(run.indirect, truth) for run in (plain, kept)]
    jumpy, calm = (root_mean(errors.change) for errors in found)
    wrong, late = (root_mean(errors.error) for errors in found)
    speed = plain.cpu.sum() / kept.cpu.sum()
    return [
        row(f"{name}.speedup", "per-frame caching's time over temporal caching's", "1", case.speedup, [speed], "higher"),
        row(f"{name}.flicker_ratio", "flicker of per-frame caching over temporal caching's", "1", None, [jumpy / calm], "higher"),
        row(f"{name}.records_ratio", "records computed, per-frame caching's over temporal caching's", "1",
            772 / 50 if name == "cube-in-a-box" else None, [plain.records.sum() / kept.records.sum()], "higher"),
        row(f"{name}.rmse_ratio", "error of temporal caching over that of per-frame caching", "1", None,
            [late / wrong], "lower"),
        row(f"{name}.rmse", "RMS error of temporal caching", "of the mean", None, [late], "lower"),
        row(f"{name}.flicker", "flicker of temporal caching", "of the mean", None, [calm], "lower"),
    ]  # fmt: skip


def accuracy_over_time(bench: Bench) -> Measurement:
    """Figure 5.10: accuracy over the life of records made together, by gradient mode, and its step where they are renewed."""
    scene, frames = bench.open("cube-in-a-box").scene, range(24)
    truth = exact(bench, scene, frames)
    rows: list[Row] = []
    steps: dict[str, float] = {}
    for mode in MODES:
        run = temporal(bench, scene, (0, 23), truth, run={**ALIKE, "gradients_in_time": mode})["run"]
        percent = accuracy(run.indirect, truth.indirect)
        steps[mode] = float(abs(percent[20] - percent[19]))
        worst = 98.0 if mode == "interpolated" else None
        rows.append(row(f"{mode}.worst", f"least accuracy, {mode}", "%", worst, [float(percent.min())], "higher"))
        rows += [
            row(f"{mode}.frame_{k}", f"accuracy at frame {k}, {mode}", "%", None, [float(percent[k])]) for k in (0, 10, 19, 20)
        ]
        lost = float(accuracy_lost(run.indirect, truth).max())
        rows += [
            row(f"{mode}.step", f"step of the accuracy at the renewal, {mode}", "percentage points", None, [steps[mode]]),
            row(f"{mode}.lost", f"accuracy that the truth's noise hides at most, {mode}", "percentage points", None, [lost]),
            row(f"{mode}.drift", f"RMS error of the change from frame 0 to 19, {mode}", "of the mean", None, [drift(run, truth)]),
        ]
    rows.append(held("order", "interpolated gradients step less at the renewal than none", [steps["interpolated"] < steps["none"]]))
    notes = [
        "every record is made to live 20 frames (a_t = 10), so that all of frame 0 expire together at frame 20",
        f"accuracy is against two hemispheres of {REFERENCE_RAYS} rays at every pixel; spatial interpolation at a = {A} bounds it",
    ]
    return Measurement("cube-in-a-box (built-in), 24 frames", rows, notes)


def drift(run: Run, truth: Truth) -> float:
    """RMS error of the change from frame 0 to frame 19, over the truth's mean."""
    changes = squares(run.indirect[19] - run.indirect[0], truth.halves[:, 19] - truth.halves[:, 0])
    return root_mean(changes) / float(truth.indirect.mean())


def memory(bench: Bench) -> Measurement:
    """Section 5.6: records, and the bytes that they take, of the whole sequence."""
    scene, case = bench.open("cube-in-a-box").scene, CASES["cube-in-a-box"]
    # how many records there are depends on their rays as little as their places do
    few = {"rays": 1024}
    plain, kept = temporal(bench, scene, case.frames, Truth.none(SIZE), plain={"cache": "per-frame", **few}, kept=few).values()
    ratio = plain.records.sum() / kept.records.sum()
    # position, normal, R, E and two gradients; with trends, frame, life and place
    static, timed = 4 * (3 + 3 + 1 + 3 + 9 + 9), 4 * (3 + 3 + 1 + 3 + 9 + 9 + 3 + 9 + 9 + 3)
    rows = [
        row("records_ratio", "records of per-frame caching over those of temporal caching", "1", 772 / 50, [ratio], "higher"),
        row("bytes_ratio", "their bytes", "1", 138 / 12.4, [ratio * static / timed], "higher"),
        row("per_frame.records", "records of per-frame caching", "1", None, [float(plain.records.sum())]),
        row("temporal.records", "records of temporal caching", "1", None, [float(kept.records.sum())]),
        row("temporal.alive", "records alive, mean over the frames", "1", None, [float(kept.alive.mean())]),
    ]
    notes = [f"float32 records of {static} bytes, of {timed} with trends; {SIZE[0]}x{SIZE[1]} pixels, a = {A}"]
    return Measurement("cube-in-a-box (built-in), 400 frames", rows, notes)


register(PublishedClaim("trc-table-5.2", "Temporal against per-frame caching on five scenes", f"{SOURCE} table 5.2", five_scenes))
register(PublishedClaim("trc-fig-5.10", "Accuracy over time by gradient mode", f"{SOURCE} figure 5.10", accuracy_over_time))
register(PublishedClaim("trc-memory", "Records and memory of a whole sequence", f"{SOURCE} section 5.6", memory))
