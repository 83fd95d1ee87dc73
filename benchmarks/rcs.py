"""Radiance cache splatting: equal time against path tracing, error over records, and glossy records by order.

Run: `python -m benchmarks.rcs [--out FOLDER] [--part equal-time|records|glossy|orders|splat] [--size 96x72]`, minutes on two cores.

Error is RMSE of the indirect layer over its mean, linear radiance, all pixels and channels, against two independent path-traced
halves, whose noise, known from their difference, is subtracted. `pt` has no indirect layer: its direct light, drawn exactly, is
subtracted. Cost is CPU seconds of the render stage, all threads. Beside each row of `rcs` stand the seconds that `pt` needs for the
same error: read off its own measured curve, which is steeper than noise without fireflies, and beyond its ends by 1/√seconds.

`orders` needs no picture: incoming radiance at points of the glossy box by 12,800 cells each, cosine-weighted Phong lobes seen
from 0°, 30° and 60°. `error` is the RMS over points and views of what n² coefficients reflect against the same cells summed
directly, over its mean; `ringing` the depth of a lobe's negative rings in % of its peak. `splat`: CPU seconds of a picture's glossy
splat by order.

Writes rcs_PART.csv, and rcs_equal-time.png, and prints each row when it is there.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderers
from benchmarks.shared.parts import Part, Row, draw_errors, parser_of, write
from benchmarks.shared.truth import SEED, Truth, rendered
from renderers.frame import Frame
from renderers.gbuffer import GBuffer
from renderers.scene.world import LAMBERT, World
from renderers.transport.caching.hemisphere import Grid
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.radiance import RadianceSampler
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.hemispherical.basis import hemispherical_harmonics
from renderers.transport.hemispherical.brdf_table import brdf_coefficients
from renderers.transport.hemispherical.models import phong
from renderers.transport.hemispherical.quadrature import hemisphere_quadrature
from renderers.transport.primary import cast_gbuffer

Image = NDArray[np.float64]
INTERIORS = ("empty-room", "cube-in-a-box", "cornell-box", "moving-light", "colonnade")
BEST: dict[str, Any] = {"placement": "hessian", "footprint": 3.0}
CURVE = [{"a": 0.6, "rays": 256}, {"a": 0.4, "rays": 512}, {"a": 0.3, "rays": 1024}, {"a": 0.2, "rays": 2048},
         {"a": 0.15, "rays": 4096}, {"a": 0.1, "rays": 8192}]  # fmt: skip
TRANSPORT = "one-bounce"
PATHS = (4, 16, 64, 256, 1024)
ACCURACIES = (0.6, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07)
GLOSSY: dict[str, dict[str, Any]] = {
    "records": {}, "records alone": {"glossy_pixels": 1},
    "traced, 64 rays": {"harmonics": 2, "lobe_rays": 64}, "traced, 256 rays": {"harmonics": 2, "lobe_rays": 256},
    "as diffuse": {"glossy": "diffuse"},
}  # fmt: skip
EXPONENTS, ORDERS, VIEWS = (5.0, 20.0, 100.0), (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12), (0.0, 30.0, 60.0)
POINTS, CELLS = 64, Grid(64, 200)


def seconds(frame: Frame, *names: str) -> float:
    """CPU seconds of the render stage, or of some of its passes."""
    return sum(t.cpu_s for t in frame.timings if t.stage == "render" and (not names or t.name in names))


def equal_time(size: tuple[int, int]) -> Iterator[Row]:
    """(scene, curve, settings, CPU seconds, error, of `rcs`: seconds of `pt` for the same error)."""
    for name in INTERIORS:
        scene = renderers.load_scene(name)
        truth = Truth.of(scene, size, TRANSPORT)
        costs, errors = list[float](), list[float]()
        for kind in ("pt", "rcs"):
            for values in [{"transport": TRANSPORT, "spp": n} for n in PATHS] if kind == "pt" else [BEST | c for c in CURVE]:
                rendered(scene, kind, (16, 12), **values)
                frame = rendered(scene, kind, size, **values)
                cost, error = seconds(frame), truth.error(frame)
                if kind == "pt":
                    costs.append(cost)
                    errors.append(error)
                    yield name, kind, f"spp={values['spp']}", round(cost, 3), round(error, 4), ""
                else:
                    needed = seconds_for(error, costs, errors)
                    yield name, kind, f"a={values['a']} rays={values['rays']}", round(cost, 3), round(error, 4), round(needed, 3)


def seconds_for(error: float, costs: list[float], errors: list[float]) -> float:
    """Where a curve of falling errors meets `error`: on straight lines in logarithms, beyond its ends by slope -1/2."""
    if error >= errors[0] or error <= errors[-1]:
        end = 0 if error >= errors[0] else -1
        return costs[end] * (errors[end] / error) ** 2
    falling = np.minimum.accumulate(errors)[::-1]
    return float(np.exp(np.interp(np.log(error), np.log(falling), np.log(costs[::-1]))))


def records(size: tuple[int, int]) -> Iterator[Row]:
    """(scene, placement, a, records, error, slope of log error over log records from the row before)."""
    for name in ("cube-in-a-box", "cornell-box"):
        scene = renderers.load_scene(name)
        truth = Truth.of(scene, size, TRANSPORT)
        for placement in ("bounded", "hessian"):
            before: tuple[float, float] | None = None
            for a in ACCURACIES:
                frame = rendered(scene, "rcs", size, a=a, rays=8192, placement=placement, footprint=1.0)
                count, error = float(frame.counters["records"]), truth.error(frame)
                slope = "" if before is None else round(np.log(error / before[1]) / np.log(count / before[0]), 2)
                before = count, error
                yield name, placement, a, int(count), round(error, 4), slope


def glossy(size: tuple[int, int]) -> Iterator[Row]:
    """(scene, way, radiance records, CPU seconds more than as diffuse, error of the glossy pixels)."""
    for name in ("cornell-glossy", "bouncing-spheres"):
        scene = renderers.load_scene(name)
        truth, shiny = Truth.of(scene, size, TRANSPORT), glossy_pixels(scene.world(), size)[1]
        rendered(scene, "rcs", (16, 12))
        plain = seconds(rendered(scene, "rcs", size, glossy="diffuse"))
        for way, values in GLOSSY.items():
            frame = rendered(scene, "rcs", size, **values)
            more = round(seconds(frame) - plain, 2)
            yield name, way, frame.counters.get("radiance_records", 0), more, round(truth.error(frame, shiny, over=shiny), 3)


def glossy_pixels(world: World, size: tuple[int, int]) -> tuple[GBuffer, NDArray[np.bool_]]:
    """First hits, and which of them are on glossy surfaces, (H, W)."""
    gbuffer = cast_gbuffer(world, size)
    return gbuffer, gbuffer.covered & (world.materials.kind[gbuffer.material] != LAMBERT)


def orders(size: tuple[int, int]) -> Iterator[Row]:
    """(exponent, order, error, ringing in %)."""
    world = renderers.load_scene("cornell-glossy").world()
    gbuffer, shiny = glossy_pixels(world, size)
    rows = np.random.default_rng(SEED).choice(np.flatnonzero(shiny), POINTS, replace=False)
    sampler = RadianceSampler(world, CELLS, ReflectedDirectLight(world), max(ORDERS), SEED, jitter=False)
    cast, _ = sampler.hemispheres(Sites(*receivers_of(world, gbuffer, rows)))
    light = cast.radiance.reshape(POINTS, -1, 3).mean(axis=2).astype(np.float64)
    directions = cell_directions(CELLS)
    weight = 2 * np.pi / CELLS.cells
    coefficients = light @ hemispherical_harmonics(directions, max(ORDERS)) * weight
    theta = np.radians(VIEWS)
    views = np.stack([np.sin(theta), np.zeros(len(theta)), np.cos(theta)], axis=1)
    quadrature = hemisphere_quadrature(96, 192)
    for exponent in EXPONENTS:
        brdf = phong(exponent)
        exact = np.stack([light @ (brdf(directions, v) * directions[:, 2]) * weight for v in views], axis=1)
        table = brdf_coefficients(brdf, views, max(ORDERS), True, quadrature).reshape(len(views), -1)
        peaks = np.array([(brdf(quadrature.directions, v) * quadrature.directions[:, 2]).max() for v in views])
        for n in ORDERS:
            found = coefficients[:, : n * n] @ table[:, : n * n].T
            lobes = table[:, : n * n] @ hemispherical_harmonics(quadrature.directions, n).T
            error = float(np.sqrt(np.mean((found - exact) ** 2)) / exact.mean())
            yield int(exponent), n, round(error, 4), round(100 * float((-lobes.min(axis=1) / peaks).max()), 2)


def cell_directions(grid: Grid) -> Image:
    """Middles of cells of equal solid angle, (cells, 3), in the frame of a hemisphere."""
    j, k = np.divmod(np.arange(grid.cells), grid.sectors)
    cosine, phi = 1 - (j + 0.5) / grid.rings, 2 * np.pi * (k + 0.5) / grid.sectors
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)


def splat(size: tuple[int, int]) -> Iterator[Row]:
    """(order, radiance records, pairs of record and pixel, CPU seconds of the glossy splat, microseconds a pair)."""
    scene = renderers.load_scene("cornell-glossy")
    for n in ORDERS:
        values: dict[str, Any] = {"harmonics": n, "sharp": "truncated", "glossy_rays": 1024, "rays": 64, "a": 1.0}
        rendered(scene, "rcs", (16, 12), **values)
        frame = rendered(scene, "rcs", size, **values)
        cost, pairs = seconds(frame, "glossy splat"), frame.counters["glossy_splats"]
        yield n, frame.counters["radiance_records"], pairs, round(cost, 3), round(1e6 * cost / pairs, 2)


PARTS = {
    "equal-time": (equal_time, ("scene", "curve", "settings", "cpu_s", "error", "pt_cpu_s")),
    "records": (records, ("scene", "placement", "a", "records", "error", "slope")),
    "glossy": (glossy, ("scene", "way", "radiance_records", "extra_cpu_s", "error")),
    "orders": (orders, ("exponent", "order", "error", "ringing_percent")),
    "splat": (splat, ("order", "radiance_records", "pairs", "cpu_s", "us_a_pair")),
}


def main() -> None:
    """Write the files of the asked parts, or of all."""
    parser = parser_of(__doc__, PARTS)
    parser.add_argument("--size", default="96x72")
    arguments = parser.parse_args()
    width, height = (int(number) for number in arguments.size.split("x"))
    parts = {name: Part(partial(rows, (width, height)), header) for name, (rows, header) in PARTS.items()}
    files = write(parts, arguments.part, arguments.out, "rcs")
    if path := files.get("equal-time"):
        draw_errors(path, path.with_suffix(".png"), "rcs")


if __name__ == "__main__":
    main()
