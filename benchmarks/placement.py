"""Error against records for the placements of radiance cache splatting: `python -m benchmarks.placement [SCENE…] [options]`.

Indirect irradiance of one view, interpolated, against hemispheres of their own at every fourth pixel: RMSE over mean. Each row is
the mean over several random orders of the records. The last columns compare with `bounded` at the same number of records (log-log
interpolation between its rows).
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import renderers
from renderers.methods.ray_records import PILOT_RAYS, placement_of
from renderers.methods.rcs import RcsSettings
from renderers.scene.world import World
from renderers.transport.caching.hemisphere import PolarSampler, grid_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.placement import fill
from renderers.transport.caching.records import Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import caster_of

SCENES = ("empty-room", "cornell-box", "cube-in-a-box", "colonnade")
WIDE = (0.8, 0.6, 0.4, 0.3, 0.2, 0.15)
ACCURACIES = {
    "split-sphere": WIDE,
    "bounded": WIDE,
    "bounded, seeing": WIDE,  # with zones that end where records don't see, as those of `hessian` do
    "hessian, blind": (0.6, 0.4, 0.3, 0.2, 0.15, 0.1),
    "hessian": (0.6, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07),
}
EVERY = 4


class Point(NamedTuple):
    """Mean number of records, root mean square error over the mean, and its largest value among the seeds."""

    a: float
    records: float
    error: float
    worst: float


class View:
    """One view of a scene, with the irradiance of every fourth pixel by 4 × as many rays as a record has."""

    def __init__(self, world: World, size: tuple[int, int], rays: int) -> None:
        self.world, self.size = world, size
        gbuffer = cast_gbuffer(world, size)
        self.canvas = Canvas.of(gbuffer)
        self.sites = Sites(*receivers_of(world, gbuffer, self.canvas.rows))
        incoming = ReflectedDirectLight(world)
        self.sampler, self.pilot = (PolarSampler(world, grid_of(n), incoming) for n in (rays, PILOT_RAYS))
        self.exact = PolarSampler(world, grid_of(4 * rays), incoming, seed=1)(self.sites.rows(slice(0, None, EVERY))).irradiance
        found = self.sampler(self.sites.rows(slice(0, None, 16 * EVERY))).irradiance
        self.noise = self._relative(found - self.exact[::16])

    def point(self, placement: str, a: float, seeds: int) -> Point:
        """Records and error of a placement, over several orders of the records."""
        counts, errors = [], []
        kind, _, sight = placement.partition(", ")
        settings = RcsSettings(placement=kind, a=a)  # type: ignore[arg-type]
        for seed in range(seeds):
            self.canvas.clear()
            how = placement_of(self.world, self.size[1], settings, seed)
            how = replace(how, sees=sight == "seeing") if sight else how
            blocked = caster_of(self.world).occluded
            counts.append(len(fill(self.canvas, self.sites, self.sampler, self.pilot.distances, how, blocked=blocked)))
            errors.append(self._relative(self.canvas.irradiance[::EVERY] - self.exact))
        return Point(a, float(np.mean(counts)), float(np.sqrt(np.mean(np.square(errors)))), max(errors))

    def _relative(self, difference: NDArray[np.floating]) -> float:
        return float(np.sqrt(np.mean(difference**2)) / self.exact.mean())


def at(points: list[Point], records: float) -> float:
    """Error of a curve at a number of records, nan outside of it."""
    count, error = (np.log([getattr(p, name) for p in points]) for name in ("records", "error"))
    order = np.argsort(count)
    return float(np.exp(np.interp(np.log(records), count[order], error[order], np.nan, np.nan)))


def slope(points: list[Point]) -> float:
    """Exponent s of error ∝ records^-s, least squares over a curve."""
    count, error = (np.log([getattr(p, name) for p in points]) for name in ("records", "error"))
    return float(-np.polyfit(count, error, 1)[0])


def report(name: str, size: tuple[int, int], rays: int, seeds: int) -> None:
    """Print the table of a scene."""
    scene = renderers.load_scene(name)
    view = View(scene.world(), size, rays)
    print(f"\n{name}, {size[0]}x{size[1]}, {rays} rays a record; the records' own noise: {view.noise:.4f}\n")
    print("| placement | a | records | RMSE / mean | worst seed | bounded at as many records | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    curves: dict[str, list[Point]] = {}
    for placement, accuracies in ACCURACIES.items():
        curves[placement] = [view.point(placement, a, seeds) for a in accuracies]
    for placement, points in curves.items():
        for p in points:
            other = at(curves["bounded"], p.records)
            row = f"| `{placement}` | {p.a:.2f} | {p.records:.0f} | {p.error:.4f} | {p.worst:.4f} |"
            print(f"{row} {other:.4f} | {other / p.error:.2f} |" if np.isfinite(other) else f"{row} | |", flush=True)
    print("\nslopes: " + ", ".join(f"{placement} {slope(points):.2f}" for placement, points in curves.items()))


def main() -> None:
    """Print a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--size", default="128x96")
    parser.add_argument("--rays", type=int, default=4096)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    width, height = (int(side) for side in given.size.split("x"))
    for name in given.scenes:
        report(name, (width, height), given.rays, given.seeds)


if __name__ == "__main__":
    main()
