"""Temporal radiance caching against caches of each frame, a cache that is never renewed, and path tracing at equal time.

Run: `python -m benchmarks.trc [--scene NAME]… [--run NAME]… [--rays N] [--size WxH] [--frames A:B] [--references K,A:B,…]
[--out FOLDER]`.
All five scenes take about a quarter of an hour on two quiet cores; a scene at a time less. Figures: docs/methods/trc.md.

`temporal` is `trc`; `per-frame` the same program with a fresh cache in every frame, the baseline of all ratios; `bounded` and
`bounded-per-frame` the same two with `placement=bounded`; `rcs` the method of that name, which places records otherwise; these
three are left out unless asked for. `static` never renews a record: ghosts as bad as they get. Caches take turns frame by frame.
`pt` and `pt-temporal` trace as many one-bounce paths a pixel as take the CPU time of `temporal`, found by a pilot. They reflect
indirect light on glossy surfaces as such, caches and the truth as on diffuse ones (`glossy=diffuse`), so their errors mean
something in diffuse scenes only. Glossy records: benchmarks/trc_glossy.py.

Errors are of indirect light, relative to its mean, against two independent hemispheres at every pixel, whose noise is taken out
(`jobs.claims.trc_runs`), in the frames that --references names; by default two windows of ten frames. Flicker is the RMS change of
the error from frame to frame, of pixels that see the same object in both, without that noise too; jump its maximum, with it; ghost
the mean signed error where a moving object hid the surface in one of the last eight frames.
Times are of the render stage; first hits, direct light and the search for what moves included.

Writes SCENE.csv (a row for each frame), SCENE_summary.csv (a row for each run) and SCENE.png, and prints the summary.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import renderers
from jobs.claims.trc_runs import Ask, FrameErrors, Run, Truth, frame_errors, root_mean, runs_of, truth_of
from jobs.claims.trc_tables import CASES, RAYS, SIZE, A
from jobs.request import ReferenceFrames
from service import parse

CACHES: dict[str, tuple[str, dict[str, Any]]] = {
    "per-frame": ("trc", {"cache": "per-frame"}),
    "temporal": ("trc", {}),
    "static": ("trc", {"cache": "static"}),
    "rcs": ("rcs", {}),
    "bounded": ("trc", {"placement": "bounded"}),
    "bounded-per-frame": ("trc", {"placement": "bounded", "cache": "per-frame"}),
}
SHARED: dict[str, Any] = {"a": A, "glossy": "diffuse"}
PATHS = ("pt", "pt-temporal")
PILOT_SPP, PILOT_FRAMES = (16, 64), 7


class Summary(NamedTuple):
    """One run: sums over all frames, root mean squares over those with a truth. Ratios: per-frame caching's over this run's, but
    for the error, where it is this one's over per-frame caching's; steady: without the first frame, where all places are new, and
    the last, where successors past the range are computed."""

    scene: str
    run: str
    settings: str
    cpu_s: float
    wall_s: float
    rays: int
    records: int
    alive: float
    rmse: float
    worst_rmse: float
    worst_frame: int
    flicker: float
    jump: float
    ghost: float
    worst_ghost: float
    speedup_cpu: float
    speedup_steady: float
    speedup_wall: float
    speedup_rays: float
    records_ratio: float
    flicker_ratio: float
    rmse_ratio: float


class Study(NamedTuple):
    """One scene: how it is rendered, and its truth."""

    name: str
    scene: renderers.Scene
    size: tuple[int, int]
    frames: tuple[int, int]
    truth: Truth
    rays: int

    def rendered(self, names: Sequence[str]) -> tuple[dict[str, Ask], dict[str, Run]]:
        """What was asked, and what came of it: caches in turns, then path tracing with the time that `temporal` took."""
        asks = {
            name: Ask(method, {**SHARED, "rays": self.rays, **values}) for name, (method, values) in CACHES.items() if name in names
        }
        for name in asks.keys() & {"temporal", "bounded"}:
            asks[name].values["delta_max"] = CASES[self.name].longest
        short = (self.frames[0], min(self.frames[0] + 1, self.frames[1]))
        runs_of(self.scene, asks, (32, 24), short, Truth.none((32, 24)))  # compiles
        runs = runs_of(self.scene, asks, self.size, self.frames, self.truth)
        seconds = float(runs["temporal"].cpu.mean())
        paths = {name: Ask(name, {"transport": "one-bounce", "spp": self.paths(name, seconds)}) for name in PATHS if name in names}
        return asks | paths, runs | runs_of(self.scene, paths, self.size, self.frames, self.truth)

    def paths(self, method: str, seconds: float) -> int:
        """Paths a pixel that take so many CPU seconds a frame."""
        asks = {str(spp): Ask(method, {"transport": "one-bounce", "spp": spp}) for spp in PILOT_SPP}
        frames = (self.frames[0], min(self.frames[0] + PILOT_FRAMES, self.frames[1]))
        few, many = (float(np.median(r.cpu)) for r in runs_of(self.scene, asks, self.size, frames, Truth.none(self.size)).values())
        slope = max((many - few) / (PILOT_SPP[1] - PILOT_SPP[0]), 1e-9)
        return max(1, round((seconds - few) / slope + PILOT_SPP[0]))


def main() -> None:
    """Render the asked scenes and runs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", action="append", choices=list(CASES), help="default: all five")
    parser.add_argument(
        "--run", action="append", choices=[*CACHES, *PATHS], help="besides per-frame and temporal; default: static and path tracing"
    )
    parser.add_argument("--rays", type=int, default=RAYS, help="of a record")
    parser.add_argument("--size", default="{}x{}".format(*SIZE))
    parser.add_argument("--frames", help="A:B; default: those of the claim trc-table-5.2")
    parser.add_argument("--references", help="as of `luxmeter evaluate`; default: two windows of ten frames")
    parser.add_argument("--out", type=Path, default=Path("trc"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.scene or CASES:
        frames = parse.frames(arguments.frames) if arguments.frames else CASES[name].frames
        chosen = parse.references(arguments.references) if arguments.references else windows(*frames)
        numbers = ReferenceFrames.model_validate(chosen).chosen(*frames)
        scene, size = renderers.load_scene(name), parse.size(arguments.size)
        study = Study(name, scene, size, frames, truth_of(scene, size, numbers), arguments.rays)
        runs = dict.fromkeys(("per-frame", "temporal", *(arguments.run or ("static", *PATHS))))
        report(study, list(runs), arguments.out)


def windows(first: int, last: int) -> dict[str, Any]:
    """Ten frames from a quarter and ten from three quarters of a range; all of a short one."""
    count = last - first + 1
    if count <= 20:
        return {"every": 1, "windows": []}
    begins = first + count // 4, first + 3 * count // 4 - 10
    return {"every": None, "windows": [(begin, begin + 9) for begin in begins]}


def report(study: Study, names: Sequence[str], out: Path) -> None:
    """Render, print, write files and plot."""
    asks, runs = study.rendered(names)
    print(f"{study.name}: noise of the truth {study.truth.noise:.4f}", flush=True)
    errors = {name: frame_errors(run.indirect, study.truth) for name, run in runs.items()}
    rows: list[Summary] = []
    for name, ask in asks.items():
        settings = " ".join(f"{key}={value}" for key, value in ask.values.items())
        rows.append(summary(study, name, settings, runs, errors))
        print(*(f"{key}={_short(value)}" for key, value in rows[-1]._asdict().items()), flush=True)
    with (out / f"{study.name}_summary.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Summary._fields)
        writer.writerows([_short(value) for value in row] for row in rows)
    write_frames(study, runs, errors, out / f"{study.name}.csv")
    draw(study, runs, errors, out / f"{study.name}.png")


def summary(study: Study, name: str, settings: str, runs: dict[str, Run], errors: dict[str, FrameErrors]) -> Summary:
    """One row."""
    run, found, plain, base = runs[name], errors[name], runs["per-frame"], errors["per-frame"]
    worst = int(np.argmax(found.error))
    ghosts = found.ghost[~np.isnan(found.ghost)]
    return Summary(
        study.name, name, settings, run.cpu.sum(), run.wall.sum(), run.rays.sum(), run.records.sum(), run.alive.mean(),
        root_mean(found.error), found.rmse[worst], study.truth.frames[worst], root_mean(found.change),
        float(np.nanmax(found.jump, initial=0)), float(ghosts.mean()) if len(ghosts) else 0.0,
        float(ghosts[np.argmax(np.abs(ghosts))]) if len(ghosts) else 0.0, _ratio(plain.cpu.sum(), run.cpu.sum()),
        _ratio(plain.cpu[1:-1].sum(), run.cpu[1:-1].sum()), _ratio(plain.wall.sum(), run.wall.sum()),
        _ratio(plain.rays.sum(), run.rays.sum()), _ratio(plain.records.sum(), run.records.sum()),
        _ratio(root_mean(base.change), root_mean(found.change)), _ratio(root_mean(found.error), root_mean(base.error)),
    )  # fmt: skip


def _ratio(above: float, below: float) -> float:
    return float(above / below) if below else float("nan")


def _short(value: object) -> object:
    return f"{value:.4g}" if isinstance(value, float) else value


def write_frames(study: Study, runs: dict[str, Run], errors: dict[str, FrameErrors], path: Path) -> None:
    """A row for each run and frame; no error where there is no truth."""
    names = "rmse", "flicker", "jump", "ghost"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["run", "frame", "cpu_s", "wall_s", "rays", "records", "alive", *names])
        for name, run in runs.items():
            known = [getattr(errors[name], column) for column in names]
            for k, columns in enumerate(zip(run.cpu, run.wall, run.rays, run.records, run.alive, strict=True)):
                frame = study.frames[0] + k
                found: list[Any] = [""] * len(names)
                if frame in study.truth.frames:
                    at = study.truth.frames.index(frame)
                    found = ["" if np.isnan(column[at]) else _short(float(column[at])) for column in known]
                writer.writerow([name, frame, *(_short(float(c)) for c in columns[:2]), *columns[2:], *found])


def draw(study: Study, runs: dict[str, Run], errors: dict[str, FrameErrors], path: Path) -> None:
    """CPU seconds and records of every frame, error and flicker of those with a truth."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(10, 6), layout="constrained")
    frames = np.arange(study.frames[0], study.frames[1] + 1)
    known = np.array(study.truth.frames)
    for index, (name, run) in enumerate(runs.items()):
        look: dict[str, Any] = {"color": f"C{index}", "lw": 1.6 if name == "temporal" else 1.0, "label": name}
        axes[0, 0].plot(frames, run.cpu, **look)
        if name not in PATHS:
            axes[0, 1].plot(frames, run.records, **look)
        axes[1, 0].plot(*_broken(known, errors[name].rmse), marker=".", ms=3, **look)
        axes[1, 1].plot(*_broken(known, errors[name].flicker), marker=".", ms=3, **look)
    titles = ("CPU seconds", "records computed", "RMS error over the mean", "flicker: RMS change of the error")
    for ax, title in zip(axes.flat, titles, strict=True):
        ax.set(title=title, xlabel="frame", yscale="log" if ax is not axes[0, 1] else "symlog")
        ax.grid(alpha=0.3, which="both", lw=0.4)
    figure.suptitle(f"{study.name}, {study.size[0]}×{study.size[1]}")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)


def _broken(frames: NDArray[np.int64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lines that don't join frames with a gap between them."""
    gaps = np.flatnonzero(np.diff(frames) > 1) + 1
    return np.insert(frames.astype(float), gaps, np.nan), np.insert(values, gaps, np.nan)


if __name__ == "__main__":
    main()
