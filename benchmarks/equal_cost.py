"""Forward light cuts at equal cost: `python -m benchmarks.equal_cost [--out FOLDER]`, about ten minutes on two cores.

Speed-against-error curves of `flc` (default, and as published), `ir`, `stochastic-lightcuts` and `pt` in eight scenes, six
built in and two of LUXMETER_SCENES (built-in ones in their place where that is unset). All draw direct light and one bounce
without occlusion of the indirect segment. Error is the noise of the whole image about a method's own limit: RMSE of linear
radiance over its mean. The limit of methods with virtual lights is `ir` with many of them and the same clamp, that of `pt` is
`pt` with many paths; the distance between the two, the clamp's bias, is printed beside. Where lights have an area, the noise
of direct light, the same for all methods with virtual lights, is a floor. Cost is CPU milliseconds of the render stage, and
light evaluations a pixel.

Writes equal_cost.png, equal_cost.csv (a row a point: mean and 95 % interval over the seeds) and equal_cost_gains.csv.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import renderers
from renderers.frame import Frame

SIZE = (192, 108)
SEEDS = 4
LIMIT_LIGHTS, LIMIT_SAMPLES, LIMIT_PATHS = 1 << 19, 256, 1024
SCENES = ("empty-room", "cornell-box", "colonnade", "cube-in-a-box", "thin-wall", "cornell-box:light=area")
SHARED, INSTEAD = ("spot", "medieval-building"), ("leaves", "bouncing-spheres")
PUBLISHED = {"family": "c0", "levels": 3, "q_a": 2.0, "q_n": 3.0, "reach": 0.56, "sampler": "uniform"}
TRANSPORT = "one-bounce-unoccluded"
CURVES: dict[str, tuple[str, list[dict[str, Any]]]] = {
    "flc": ("flc", [{"vpls": n} for n in (1024, 4096, 16384, 65536)]),
    "flc, published": ("flc", [{"vpls": n, **PUBLISHED} for n in (1024, 4096, 16384)]),
    "ir, low-discrepancy": ("ir", [{"vpls": n, "sampler": "low-discrepancy"} for n in (512, 2048, 8192)]),
    "ir": ("ir", [{"vpls": n} for n in (512, 2048, 8192)]),
    "stochastic-lightcuts": ("stochastic-lightcuts", [{"vpls": 16384, "cut_size": n} for n in (8, 24, 72)]),
    "pt": ("pt", [{"transport": TRANSPORT, "spp": n} for n in (1, 4, 16, 64)]),
}


class Point(NamedTuple):
    """A method in a scene with one setting: means over seeds, half-width of the error's 95 % interval."""

    scene: str
    curve: str
    setting: str
    milliseconds: float
    evaluations: float
    error: float
    margin: float


def main() -> None:
    """Render, write the files, print the gains."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("equal-cost"))
    parser.add_argument("--scene", action="append", help="instead of the eight scenes")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    scenes = arguments.scene or [*SCENES, *(SHARED if os.environ.get("LUXMETER_SCENES") else INSTEAD)]
    points = [point for scene in scenes for point in measured(scene)]
    with (arguments.out / "equal_cost.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Point._fields)
        writer.writerows(points)
    gains = [gain for scene in scenes for gain in gains_of([p for p in points if p.scene == scene])]
    with (arguments.out / "equal_cost_gains.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("scene", "against", "cost", "gain"), *gains])
    summarise(gains)
    draw(points, scenes, arguments.out / "equal_cost.png")


def opened(text: str) -> renderers.Scene:
    """A scene by name, with parameters after a colon."""
    name, _, parameter = text.partition(":")
    key, _, value = parameter.partition("=")
    return renderers.load_scene(name, **{key: value}) if key else renderers.load_scene(name)


def measured(text: str) -> list[Point]:
    """All points of a scene. Seeds are the outer loop, so that what else the machine does meets all settings alike."""
    scene = opened(text)
    lights = limit(scene, "ir", vpls=LIMIT_LIGHTS, sampler="low-discrepancy", light_samples=LIMIT_SAMPLES)
    paths = limit(scene, "pt", transport=TRANSPORT, spp=LIMIT_PATHS)
    print(f"{text}: the clamp's bias is {distance(lights, paths):.4f} of the mean", flush=True)
    runs: dict[tuple[str, str], list[tuple[float, float, float]]] = defaultdict(list)
    for seed in range(-1, SEEDS):
        for curve, (kind, settings) in CURVES.items():
            for values in settings:
                frame = rendered(scene, kind, max(seed, 0), values)
                if seed < 0:
                    break  # once a method, to compile and load what it needs
                error = distance(frame.layers["beauty"], paths if kind == "pt" else lights)
                name = next(k for k in ("cut_size", "spp", "vpls") if k in values)
                runs[curve, f"{name}={values[name]}"].append((milliseconds(frame), evaluations(frame), error))
    return [summary(text, *key, np.array(values)) for key, values in runs.items()]


def limit(scene: renderers.Scene, kind: str, **values: Any) -> NDArray[np.float32]:
    """What a method converges to."""
    return rendered(scene, kind, 1 << 20, values).layers["beauty"]


def rendered(scene: renderers.Scene, kind: str, seed: int, values: dict[str, Any]) -> Frame:
    """One frame on the CPU."""
    method = renderers.get_method(kind)
    backend = {"backend": "cpu"} if kind in ("ir", "flc") else {}
    return method.render(scene, method.Settings(**values, **backend), size=SIZE, seed=seed)


def distance(image: NDArray[np.float32], truth: NDArray[np.float32]) -> float:
    """RMSE over the mean, linear radiance, all pixels and channels."""
    return float(np.sqrt(np.mean((image.astype(np.float64) - truth) ** 2)) / truth.mean())


def milliseconds(frame: Frame) -> float:
    """CPU milliseconds of the render stage."""
    return 1e3 * sum(t.cpu_s for t in frame.timings if t.stage == "render")


def evaluations(frame: Frame) -> float:
    """Light evaluations a covered pixel; 0 for path tracing, which has none."""
    return frame.counters.get("light_evaluations", 0) / max(1, frame.counters.get("pixels_covered", 1))


def summary(scene: str, curve: str, setting: str, values: NDArray[np.float64]) -> Point:
    """Means of (milliseconds, evaluations, error) rows, and Student's t interval of the error; the time is a median."""
    margin = stats.t.ppf(0.975, len(values) - 1) * stats.sem(values[:, 2])
    return Point(scene, curve, setting, float(np.median(values[:, 0])), *values[:, 1:].mean(axis=0), float(margin))


def gains_of(points: list[Point]) -> list[tuple[str, str, str, float]]:
    """(scene, other curve, cost, gain): error² of another curve over that of flc's default at equal cost.

    Geometric mean over the costs that both curves were measured at, both read as polygons in log-log; left out where there are
    none.
    """
    gains = []
    for curve in CURVES:
        for cost in ("milliseconds", "evaluations"):
            (x, y), (ours, errors) = (polygon(points, name, cost) for name in (curve, "flc"))
            low, high = max(x[0], ours[0]), min(x[-1], ours[-1])
            if curve == "flc" or low >= high:
                continue
            at = np.linspace(low, high, 101)
            gain = np.exp(2 * np.mean(np.interp(at, x, y) - np.interp(at, ours, errors)))
            gains.append((points[0].scene, curve, cost, float(gain)))
    return gains


def polygon(points: list[Point], curve: str, cost: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Logarithms of cost, ascending, and of error of one curve."""
    own = sorted((getattr(p, cost), p.error) for p in points if p.curve == curve)
    x, y = np.log(np.maximum(np.array(own), 1e-30)).T
    return x, y


def summarise(gains: list[tuple[str, str, str, float]]) -> None:
    """Print gains by scene, and their median."""
    for cost in ("milliseconds", "evaluations"):
        for curve in CURVES:
            found = {scene: gain for scene, other, kind, gain in gains if (other, kind) == (curve, cost)}
            if found:
                each = ", ".join(f"{scene} {gain:.2f}" for scene, gain in found.items())
                print(f"error² over flc's at equal {cost}, {curve}: median {np.median(list(found.values())):.2f}; {each}")


def draw(points: list[Point], scenes: list[str], path: Path) -> None:
    """One panel a scene: error against CPU milliseconds, logarithmic, with intervals."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot, ticker

    columns = min(4, len(scenes))
    rows = -(-len(scenes) // columns)
    figure, axes = pyplot.subplots(rows, columns, figsize=(3.4 * columns, 3.0 * rows + 0.5), squeeze=False, layout="constrained")
    for ax, scene in zip(axes.flat, scenes, strict=False):
        for index, curve in enumerate(CURVES):
            own = sorted((p for p in points if (p.scene, p.curve) == (scene, curve)), key=lambda p: p.milliseconds)
            x, y, margin = ([getattr(p, name) for p in own] for name in ("milliseconds", "error", "margin"))
            low = [min(m, 0.9 * e) for m, e in zip(margin, y, strict=True)]
            ax.errorbar(x, y, [low, margin], marker="o", ms=3, lw=2 if curve == "flc" else 1, color=f"C{index}", label=curve)
        ax.set(xscale="log", yscale="log", title=scene)
        ax.xaxis.set_minor_formatter(ticker.NullFormatter())
        ax.yaxis.set_minor_formatter(ticker.NullFormatter())
        ax.grid(alpha=0.3, which="both", lw=0.4)
    figure.supxlabel("CPU milliseconds a frame")
    figure.supylabel("RMSE over mean radiance")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=9)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
