"""Table 5.2 and Figure 5.10 of Laurent 2018: milliseconds of the whole pipeline, and what interleaved sub-images save and cost.

The figures are of a Quadro M6000 and of scenes that can't be shipped. They are shown beside this machine's, not compared; what the
text says in words is: more sub-images are faster, until the rest of the frame is all there is.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any, NamedTuple

from jobs.claims.bench import Bench, display_rmse, render_seconds
from jobs.claims.model import Measurement, PublishedClaim, Row, held, row
from jobs.claims.registry import register
from renderers import Frame

SIZE = (640, 352)
VPLS = 16384
REPEATS = 4
# the publication's levels, and points drawn triangle by triangle as in its chapter 5
PUBLISHED = {"family": "c0", "sampler": "resampled", "visibility": "none"}
LUCY = "colonnade:triangles=2000000"


class Case(NamedTuple):
    """A column of Table 5.2: its name, the scene in its place, tiles, and printed milliseconds of direct, indirect, frame."""

    name: str
    scene: str
    tiles: int
    direct: float
    indirect: float
    frame: float


CASES = (
    Case("sponza", "colonnade:triangles=200000", 64, 4, 4, 8),
    Case("platform", "gears", 4, 1, 13, 14),
    Case("lucy_1", LUCY, 1, 18, 75, 93),
    Case("lucy_4", LUCY, 4, 18, 30, 48),
    Case("lucy_16", LUCY, 16, 18, 15, 33),
)
FIGURE = {1: 93.0, 4: 48.0, 16: 33.0, 64: 33.0}
DIRECT, INDIRECT = ("gbuffer", "direct"), ("resample", "vpls", "splat")
MACHINE = "the publication's milliseconds are of a Quadro M6000; they are shown, not compared"


def table(bench: Bench) -> Measurement:
    """Table 5.2: direct, indirect and frame times of five columns."""
    frames = {case: [tiled(bench, case.scene, case.tiles, seed) for seed in range(REPEATS)] for case in CASES}
    rows = [r for case, made in frames.items() for r in case_rows(case, made)]
    notes = (
        MACHINE,
        "passes: points (resampled triangle by triangle, with subdivision), their light, splats with the filter",
        "colonnade with 200,000 triangles stands for Sponza (270k), gears (79k) for the platform (700k), colonnade with 2,000,000 "
        f"for Lucy (28M); {SIZE[0]}x{SIZE[1]} instead of 1280x720, N = {VPLS}, direct light ray cast",
    )
    return Measurement("colonnade, gears (built-in)", rows, notes)


def case_rows(case: Case, frames: list[Frame]) -> list[Row]:
    """One column: the printed times beside this machine's, and two passes that the publication cuts otherwise."""
    parts = {
        "direct": DIRECT,
        "indirect": INDIRECT,
        "frame": DIRECT + INDIRECT,
        "points": ("resample",),
        "lights": ("vpls",),
        "splat": ("splat",),
    }
    return [
        row(
            f"{case.name}.{part}_ms", f"time of {part}", "ms", getattr(case, part, None),
            [milliseconds(f, passes) for f in frames], "lower", comparable=False,
        )
        for part, passes in parts.items()
    ]  # fmt: skip


def figure(bench: Bench) -> Measurement:
    """Figure 5.10: frame time and image against the number of sub-images."""
    times: dict[int, list[float]] = defaultdict(list)
    errors: dict[int, list[float]] = defaultdict(list)
    for seed in range(REPEATS):
        frames = {tiles: tiled(bench, LUCY, tiles, seed) for tiles in FIGURE}
        whole = frames[1].layers["beauty"]
        exposure = bench.exposure(bench.open(LUCY), whole)
        for tiles, frame in frames.items():
            times[tiles].append(milliseconds(frame, DIRECT + INDIRECT))
            errors[tiles].append(display_rmse(frame.layers["beauty"], whole, exposure))
    notes = (
        MACHINE,
        f"colonnade with 2,000,000 triangles instead of Lucy (28M), {SIZE[0]}x{SIZE[1]} instead of 1024x1024, N = {VPLS}",
    )
    return Measurement(f"{LUCY} (built-in) in place of Lucy", figure_rows(times, errors), notes)


def figure_rows(times: dict[int, list[float]], errors: dict[int, list[float]]) -> list[Row]:
    """Figures by number of sub-images, and what the text says of them."""
    rows: list[Row] = []
    for tiles, printed in FIGURE.items():
        name, many = f"tiles_{tiles}", f"with {tiles} sub-images"
        rows.append(row(f"{name}.frame_ms", f"frame time {many}", "ms", printed, times[tiles], "lower", comparable=False))
        if tiles > 1:
            gain = [a / b for a, b in zip(times[1], times[tiles], strict=True)]
            rows += [
                row(f"{name}.speedup", f"frame time with 1 over that {many}", "1", FIGURE[1] / printed, gain, comparable=False),
                row(f"{name}.rmse", f"RMSE of display values {many} against 1", "0-255", None, errors[tiles], "lower"),
            ]
    return [
        *rows,
        held("more_tiles_faster", "4 sub-images are faster than 1, and 16 than 4", faster(times)),
        held("last_step_small", "the step from 16 to 64 saves less than that from 1 to 4", saturated(times)),
    ]


def faster(times: dict[int, list[float]]) -> list[bool]:
    """Whether each of the first two steps saved time, by repeat."""
    return [a > b for k in ((1, 4), (4, 16)) for a, b in zip(times[k[0]], times[k[1]], strict=True)]


def saturated(times: dict[int, list[float]]) -> list[bool]:
    """Whether the last step saved less than the first, by repeat."""
    return [c - d < a - b for a, b, c, d in zip(times[1], times[4], times[16], times[64], strict=True)]


def tiled(bench: Bench, scene: str, tiles: int, seed: int) -> Frame:
    """A frame with that many sub-images."""
    settings: dict[str, Any] = {**PUBLISHED, "vpls": VPLS, "interleave": round(tiles**0.5)}
    return bench.render(bench.open(scene), "flc", size=SIZE, seed=seed, **settings)


def milliseconds(frame: Frame, passes: tuple[str, ...]) -> float:
    """Wall time of the named passes."""
    others = tuple({t.name for t in frame.timings} - set(passes))
    return 1e3 * render_seconds(frame, without=others)


register(PublishedClaim("flc-table-5.2", "Frame times of forward light cuts by pass", "Laurent 2018 Table 5.2", table))
register(PublishedClaim("flc-fig-5.10", "Interleaved sub-images: time and image", "Laurent 2018 Figure 5.10", figure))
