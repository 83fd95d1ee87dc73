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

Writes pmic_PART.csv, and pmic_equal-time.png, and prints each row when it is there.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderers
from benchmarks.shared.parts import Part, Row, draw_errors, parser_of, write
from benchmarks.shared.truth import EVERYWHERE, SEED, Truth, rendered
from jobs.claims.radiance_system import RadianceScene
from renderers.frame import Frame
from renderers.gbuffer import GBuffer
from renderers.methods.pmic import PhotonMappedIrradianceCaching
from renderers.transport.primary import cast_gbuffer

SIZE, WIDE = (160, 120), (1280, 720)
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


@cache
def truth_of(name: str) -> Truth:
    """The truth of a scene, all bounces."""
    return Truth.of(renderers.load_scene(name), SIZE)


def seconds(frame: Frame) -> float:
    """CPU seconds of all passes but warm-up."""
    return sum(t.cpu_s for t in frame.timings if t.name != "warm-up")


def text(values: dict[str, Any]) -> str:
    """Settings as words."""
    return " ".join(f"{k}={v}" for k, v in values.items())


def errors() -> Iterator[Row]:
    """(scene, method, settings, records, error, that of the first case over it; both of pixels inside surfaces only)."""
    for name in ERROR_SCENES:
        scene, first = renderers.load_scene(name), np.zeros(0)
        truth = truth_of(name)
        flat = inside(cast_gbuffer(scene.world(), SIZE))
        for kind, values in CASES:
            frame = rendered(scene, kind, SIZE, **values)
            found = np.array([truth.error(frame, where) for where in (EVERYWHERE, flat)])
            first = first if len(first) else found
            yield name, kind, text(values), frame.counters.get("records", 0), *np.stack([found, first / found], 1).ravel().round(4)


def equal_time() -> Iterator[Row]:
    """(scene, curve, settings, CPU seconds, error)."""
    for name in TIME_SCENES:
        scene = renderers.load_scene(name)
        truth = truth_of(name)
        for kind, cases in CURVES.items():
            rendered(scene, kind, (32, 24), **cases[0])
            for values in cases:
                frame = rendered(scene, kind, SIZE, **values)
                yield name, kind, text(values), round(seconds(frame), 3), round(truth.error(frame), 4)
        with tempfile.TemporaryDirectory() as folder:
            system = RadianceScene(scene.world(), Path(folder))
            unlit = system.image(SIZE, 0)
            for photons in RADIANCE_PHOTONS:
                cost = system.trace_photons(photons, SEED).cpu
                image, spent = system.gathered(SIZE, RADIANCE_OPTIONS)
                yield name, "Radiance", f"photons={photons}", round(cost + spent.cpu, 3), round(truth.error(image - unlit), 4)


def split() -> Iterator[Row]:
    """(scene, interpolation, density estimate, photons and gathering), each RMS over the mean."""
    for name in ERROR_SCENES:
        scene = renderers.load_scene(name)
        truth = truth_of(name)
        kinds = ("walk", "pixels", "gather")
        walk, pixels, gather = (rendered(scene, "pmic", SIZE, records=kind).layers["indirect"] for kind in kinds)
        apart = [float(np.sqrt(np.mean((a - b) ** 2)) / truth.indirect.mean()) for a, b in ((walk, pixels), (pixels, gather))]
        yield name, *(round(value, 4) for value in (*apart, truth.error(gather)))


def walkthrough() -> Iterator[Row]:
    """(scene, error, CPU seconds of a frame from a built cache, paths a pixel of `pt` for that error, its CPU seconds, ratio)."""
    method = PhotonMappedIrradianceCaching()
    for name in TIME_SCENES:
        scene = renderers.load_scene(name)
        truth = truth_of(name)
        ours = truth.error(rendered(scene, "pmic", SIZE))
        spp = 64
        needed = spp * (truth.error(rendered(scene, "pt", SIZE, spp=spp)) / ours) ** 2
        paths = seconds(rendered(scene, "pt", WIDE, spp=4)) / 4 * needed
        frames = method.walkthrough(scene, None, [scene.world().camera] * 3, size=WIDE, seed=SEED)
        frame = min(seconds(f) for f in frames[1:])
        yield name, round(ours, 4), round(frame, 3), round(needed), round(paths, 1), round(paths / frame, 1)


PARTS = {
    "errors": Part(errors, ("scene", "method", "settings", "records", "error", "ratio", "error_inside", "ratio_inside")),
    "split": Part(split, ("scene", "interpolation", "density", "photons")),
    "equal-time": Part(equal_time, ("scene", "curve", "settings", "cpu_s", "error")),
    "walkthrough": Part(walkthrough, ("scene", "error", "frame_cpu_s", "pt_spp", "pt_cpu_s", "ratio")),
}


def main() -> None:
    """Write the files of the asked parts, or of all."""
    arguments = parser_of(__doc__, PARTS).parse_args()
    files = write(PARTS, arguments.part, arguments.out, "pmic")
    if path := files.get("equal-time"):
        draw_errors(path, path.with_suffix(".png"), "pmic", "CPU seconds a frame, preparation included")


if __name__ == "__main__":
    main()
