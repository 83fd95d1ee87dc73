"""Photon-mapped irradiance caching: error over photons and records, at equal time against its peers, and of a walkthrough.

Run: `python -m benchmarks.pmic_error [--out FOLDER] [--part errors|split|equal-time|walkthrough]`, about ten minutes on two cores.

Error is RMSE of the indirect layer over its mean, linear radiance, all pixels and channels, against Mitsuba's `full` transport (two
independent path-traced halves, whose noise, known from their difference, is subtracted). `pt` has no indirect layer: its direct
light, drawn exactly, is subtracted. Cost is CPU seconds of all threads, preparation included, compilation and export not.
Radiance: `mkpmap` and then final gathering by its irradiance cache (`rtrace -ab 1`); its CPU seconds are of one thread.
The walkthrough: frames at 1280×720 from a built cache, against the paths that `pt` needs for the same error there; noise of `pt`
falls as 1/√spp, and a pixel's variance doesn't depend on how many pixels there are.

The split: what interpolation between records adds (RMS difference to a record at every pixel), what their density estimate adds (to
final gathering from the same photons), and what those photons and rays leave (to the truth).

Writes pmic_errors.csv, pmic_split.csv, pmic_equal_time.csv and .png, pmic_walkthrough.csv, and prints each row when it is there.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import renderers
from jobs.claims.radiance_system import RadianceScene
from renderers.frame import Frame
from renderers.gbuffer import GBuffer
from renderers.methods.pmic import PhotonMappedIrradianceCaching
from renderers.transport.primary import cast_gbuffer

Image = NDArray[np.float64]
SIZE, SEED, HALF, WIDE = (160, 120), 1, 1024, (1280, 720)
ERROR_SCENES = ("empty-room", "cube-in-a-box", "cornell-box", "colonnade", "cornell-glossy")
TIME_SCENES = ERROR_SCENES[:3]
CASES: list[tuple[str, dict[str, Any]]] = [
    ("photon-map", {"photons": 400_000}),
    *(("pmic", {"photons": n}) for n in (100_000, 400_000, 1_600_000)),
    *(("pmic", {"photons": 400_000, "a": a}) for a in (0.3, 0.5)),
]
CURVES: dict[str, list[dict[str, Any]]] = {
    "pmic": [{"photons": n} for n in (25_000, 100_000, 400_000, 1_600_000)],
    "photon-map": [{"photons": n} for n in (25_000, 100_000, 400_000, 1_600_000)],
    "photon-map-final-gather": [{"rays": n} for n in (4, 16, 64)],
    "pt": [{"spp": n} for n in (4, 16, 64, 256)],
    "rcs": [{"bounces": "all", "a": 0.3, "rays": 256}, {"bounces": "all", "a": 0.15, "rays": 1024}],
}
RADIANCE_PHOTONS, RADIANCE_OPTIONS = (12_500, 50_000, 200_000), "-ad 512 -aa 0.2 -as 0"


class Truth(NamedTuple):
    """Direct light, indirect light and its noise variance (H, W, 3); inside (H, W): pixels whose neighbours share their plane."""

    direct: Image
    indirect: Image
    variance: Image
    inside: NDArray[np.bool_]

    @staticmethod
    def of(scene: renderers.Scene) -> Truth:
        """By path tracing."""
        direct = rendered(scene, "pt", transport="direct", spp=256).layers["beauty"].astype(np.float64)
        halves = [rendered(scene, "pt", seed=seed, spp=HALF).layers["beauty"] - direct for seed in (101, 102)]
        mean, apart = (halves[0] + halves[1]) / 2, halves[0] - halves[1]
        return Truth(direct, mean, apart**2 / 4, inside(cast_gbuffer(scene.world(), SIZE)))

    def error(self, indirect: NDArray[np.floating], where: NDArray[np.bool_] | slice = slice(None)) -> float:
        """RMSE over the mean of the whole image, less the truth's own noise, of the pixels `where`."""
        square = float(np.mean(((indirect - self.indirect) ** 2 - self.variance)[where]))
        return float(np.sqrt(max(square, 0.0)) / self.indirect.mean())

    def error_of(self, frame: Frame) -> float:
        """Error of a frame's indirect light."""
        return self.error(frame.layers["indirect"] if "indirect" in frame.layers else frame.layers["beauty"] - self.direct)


def inside(gbuffer: GBuffer) -> NDArray[np.bool_]:
    """Pixels whose eight neighbours lie on the plane that they see, bool (H, W)."""
    position, normal = gbuffer.position, gbuffer.normal
    same = gbuffer.covered.copy()
    for shift in np.ndindex(3, 3):
        by = (shift[0] - 1, shift[1] - 1)
        step = np.roll(position, by, (0, 1)) - position
        same &= np.einsum("hwc,hwc->hw", np.roll(normal, by, (0, 1)), normal) > 0.95
        same &= np.abs(np.einsum("hwc,hwc->hw", step, normal)) < 1e-3
    return same


def rendered(scene: renderers.Scene, kind: str, seed: int = SEED, size: tuple[int, int] = SIZE, **values: Any) -> Frame:
    """One frame."""
    method = renderers.get_method(kind)
    return method.render(scene, method.Settings(**values), size=size, seed=seed)


def seconds(frame: Frame) -> float:
    """CPU seconds of all passes but warm-up."""
    return sum(t.cpu_s for t in frame.timings if t.name != "warm-up")


def text(values: dict[str, Any]) -> str:
    """Settings as words."""
    return " ".join(f"{k}={v}" for k, v in values.items())


def errors(truths: dict[str, Truth]) -> Iterator[tuple[Any, ...]]:
    """(scene, method, settings, records, error, that of the first case over it; both of pixels inside surfaces only)."""
    for name in ERROR_SCENES:
        scene, first = renderers.load_scene(name), np.zeros(0)
        truth = truths.setdefault(name, Truth.of(scene))
        for kind, values in CASES:
            frame = rendered(scene, kind, **values)
            found = np.array([truth.error(frame.layers["indirect"], where) for where in (slice(None), truth.inside)])
            first = first if len(first) else found
            yield name, kind, text(values), frame.counters.get("records", 0), *np.stack([found, first / found], 1).ravel().round(4)


def equal_time(truths: dict[str, Truth]) -> Iterator[tuple[Any, ...]]:
    """(scene, curve, settings, CPU seconds, error)."""
    for name in TIME_SCENES:
        scene = renderers.load_scene(name)
        truth = truths.setdefault(name, Truth.of(scene))
        for kind, cases in CURVES.items():
            rendered(scene, kind, size=(32, 24), **cases[0])
            for values in cases:
                frame = rendered(scene, kind, **values)
                yield name, kind, text(values), round(seconds(frame), 3), round(truth.error_of(frame), 4)
        with tempfile.TemporaryDirectory() as folder:
            system = RadianceScene(scene.world(), Path(folder))
            unlit = system.image(SIZE, 0)
            for photons in RADIANCE_PHOTONS:
                cost = system.trace_photons(photons, SEED).cpu
                image, spent = system.gathered(SIZE, RADIANCE_OPTIONS)
                yield name, "Radiance", f"photons={photons}", round(cost + spent.cpu, 3), round(truth.error(image - unlit), 4)


def split(truths: dict[str, Truth]) -> Iterator[tuple[Any, ...]]:
    """(scene, interpolation, density estimate, photons and gathering), each RMS over the mean."""
    for name in ERROR_SCENES:
        scene = renderers.load_scene(name)
        truth = truths.setdefault(name, Truth.of(scene))
        kinds = ("walk", "pixels", "gather")
        walk, pixels, gather = (rendered(scene, "pmic", records=kind).layers["indirect"] for kind in kinds)
        apart = [float(np.sqrt(np.mean((a - b) ** 2)) / truth.indirect.mean()) for a, b in ((walk, pixels), (pixels, gather))]
        yield name, *(round(value, 4) for value in (*apart, truth.error(gather)))


def walkthrough(truths: dict[str, Truth]) -> Iterator[tuple[Any, ...]]:
    """(scene, error, CPU seconds of a frame from a built cache, paths a pixel of `pt` for that error, its CPU seconds, ratio)."""
    method = PhotonMappedIrradianceCaching()
    for name in TIME_SCENES:
        scene = renderers.load_scene(name)
        truth = truths.setdefault(name, Truth.of(scene))
        ours = truth.error_of(rendered(scene, "pmic"))
        spp = 64
        needed = spp * (truth.error_of(rendered(scene, "pt", spp=spp)) / ours) ** 2
        paths = seconds(rendered(scene, "pt", size=WIDE, spp=4)) / 4 * needed
        frames = method.walkthrough(scene, None, [scene.world().camera] * 3, size=WIDE, seed=SEED)
        frame = min(seconds(f) for f in frames[1:])
        yield name, round(ours, 4), round(frame, 3), round(needed), round(paths, 1), round(paths / frame, 1)


PARTS = {
    "errors": (errors, "pmic_errors", ("scene", "method", "settings", "records", "error", "ratio", "error_inside", "ratio_inside")),
    "split": (split, "pmic_split", ("scene", "interpolation", "density", "photons")),
    "equal-time": (equal_time, "pmic_equal_time", ("scene", "curve", "settings", "cpu_s", "error")),
    "walkthrough": (walkthrough, "pmic_walkthrough", ("scene", "error", "frame_cpu_s", "pt_spp", "pt_cpu_s", "ratio")),
}


def main() -> None:
    """Write the files of the asked parts, or of all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pmic-error"))
    parser.add_argument("--part", choices=list(PARTS), action="append")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    truths: dict[str, Truth] = {}
    for part in arguments.part or list(PARTS):
        rows, name, header = PARTS[part]
        path = arguments.out / f"{name}.csv"
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            for row in rows(truths):
                writer.writerow(row)
                file.flush()
                print(*row, flush=True)
        if part == "equal-time":
            draw(path, path.with_suffix(".png"))


def draw(table: Path, picture: Path) -> None:
    """One panel a scene: error against CPU seconds, logarithmic."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    curves = [*CURVES, "Radiance"]
    figure, axes = pyplot.subplots(1, len(TIME_SCENES), figsize=(3.6 * len(TIME_SCENES), 3.6), squeeze=False, layout="constrained")
    for ax, scene in zip(axes.flat, TIME_SCENES, strict=True):
        for curve in curves:
            own = sorted((float(r["cpu_s"]), float(r["error"])) for r in rows if (r["scene"], r["curve"]) == (scene, curve))
            ax.plot(*zip(*own, strict=True), marker="o", ms=3, lw=2 if curve == "pmic" else 1, label=curve)
        ax.set(xscale="log", yscale="log", title=scene)
        ax.grid(alpha=0.3, which="both", lw=0.4)
    figure.supxlabel("CPU seconds a frame, preparation included")
    figure.supylabel("RMSE of indirect light over its mean")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=8)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
