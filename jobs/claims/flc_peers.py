"""Table 5.3 of Laurent 2018: direct light alone, SSDO, deep screen space and forward light cuts on five scenes.

The table consists of pictures; its times are lost. What the text says in words is measured: forward light cuts are similar to deep
screen space or better, and faster, the more so the more polygons there are; SSDO is faster on large scenes but misses what the
camera doesn't see. Truth is path tracing of one bounce with occlusion.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any, NamedTuple

import numpy as np

from jobs.claims.bench import Bench, display_rmse, render_seconds
from jobs.claims.model import Measurement, PublishedClaim, Row, held, row
from jobs.claims.registry import register
from jobs.scenes import NamedScene, scene_folders

SIZE = (320, 180)
REPEATS = 4
# triangles rise from scene to scene
BUILT_IN = ("colonnade:triangles=20000", "gears", "colonnade:triangles=200000", "colonnade:triangles=2000000")
FROM_FOLDER = ("medieval-building", "satellite")
LARGE = 150_000
NOISE, REFERENCE_SECONDS = 0.01, 60.0
PASSES = {"ssdo": ("bounce",), "dss": ("surfels", "light", "splat"), "flc": ("resample", "vpls", "splat")}
SETTINGS: dict[str, dict[str, Any]] = {
    "ssdo": {},
    "dss": {"interleave": 4},
    "flc": {"family": "c0", "sampler": "resampled", "quality": 0.5, "interleave": 4},
}


class Found(NamedTuple):
    """Figures of one scene by method, one for each repeat; `direct` has errors only."""

    triangles: int
    seconds: dict[str, list[float]]
    rmse: dict[str, list[float]]
    light: dict[str, list[float]]


def measure(bench: Bench) -> Measurement:
    """Errors, times and energies of every scene, and what they say together."""
    names = (*(n for n in FROM_FOLDER if n in scene_folders()), *BUILT_IN)
    found = {n: compared(bench, bench.open(n)) for n in names}
    rows = [r for n, f in found.items() for r in rows_of(n, f)]
    all_faster = [a > b for f in found.values() for a, b in zip(f.seconds["dss"], f.seconds["flc"], strict=True)]
    as_good = [b <= 1.1 * a for f in found.values() for a, b in zip(f.rmse["dss"], f.rmse["flc"], strict=True)]
    gains = [np.divide(found[n].seconds["dss"], found[n].seconds["flc"]) for n in BUILT_IN if n.startswith("colonnade")]
    large = [f for f in found.values() if f.triangles >= LARGE]
    rows += [
        held("flc_faster_than_dss", "indirect light of flc takes less time than that of dss", all_faster),
        held("flc_as_good_as_dss", "RMSE of flc is at most 1.1 times that of dss", as_good),
        held("gain_grows", "time of dss over flc grows with the triangles of colonnade", list(gains[-1] > gains[0])),
        held("ssdo_faster_when_large", f"ssdo takes less time than flc from {LARGE:,} triangles on",
             [a < b for f in large for a, b in zip(f.seconds["ssdo"], f.seconds["flc"], strict=True)]),
        held("ssdo_misses_light", "ssdo finds less indirect light than flc",
             [a < b for f in found.values() for a, b in zip(f.light["ssdo"], f.light["flc"], strict=True)]),
    ]  # fmt: skip
    absent = "" if len(names) > len(BUILT_IN) else "; LUXMETER_SCENES has none of " + ", ".join(FROM_FOLDER)
    notes = (
        f"the publication's scenes can't be shipped{absent}; {SIZE[0]}x{SIZE[1]}, truth with noise {NOISE} or what "
        f"{REFERENCE_SECONDS:.0f} s give",
        "dss and flc on 16 sub-images, other settings at their defaults; times are of the passes of indirect light",
    )
    return Measurement(", ".join(names) + (" (LUXMETER_SCENES and built-in)" if not absent else " (built-in)"), rows, notes)


def compared(bench: Bench, scene: NamedScene) -> Found:
    """One scene's figures. The share of light is of the reference's one bounce, in luminance."""
    from renderers.images import luminance

    truth = bench.reference(scene, "one-bounce", size=SIZE, noise=NOISE, max_seconds=REFERENCE_SECONDS).image
    exposure = bench.exposure(scene, truth)
    found = Found(len(scene.scene.world().triangles), defaultdict(list), defaultdict(list), defaultdict(list))
    for seed in range(REPEATS):
        for method, passes in PASSES.items():
            frame = bench.render(scene, method, size=SIZE, seed=seed, **SETTINGS[method])
            others = tuple({t.name for t in frame.timings} - set(passes))
            found.seconds[method].append(render_seconds(frame, without=others))
            found.rmse[method].append(display_rmse(frame.layers["beauty"], truth, exposure))
            bounce = luminance(truth).sum() - luminance(frame.layers["direct"]).sum()
            found.light[method].append(float(luminance(frame.layers["indirect"]).sum() / bounce))
            if method == "flc":
                found.rmse["direct"].append(display_rmse(frame.layers["direct"], truth, exposure))
    return found


def rows_of(name: str, found: Found) -> list[Row]:
    """What was measured of one scene; the publication has no figures."""
    return [
        row(f"{name}.{method}.{id}", f"{title}, {method}", unit, None, values)
        for id, title, unit, figures in (
            ("indirect_ms", "time of indirect light", "ms", {m: [1e3 * s for s in v] for m, v in found.seconds.items()}),
            ("rmse", "RMSE of display values against one bounce", "0-255", found.rmse),
            ("light", "indirect light over that of the reference", "1", found.light),
        )
        for method, values in figures.items()
    ]


register(
    PublishedClaim("flc-table-5.3", "Forward light cuts against SSDO and deep screen space", "Laurent 2018 Table 5.3", measure)
)
