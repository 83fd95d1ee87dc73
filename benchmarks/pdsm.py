"""Penumbra deep shadow maps: seconds of construction against samples and resolution, and lookups per second.

Run on an idle machine: `python benchmarks/pdsm.py`. Prints medians; construction is linear in N, quadratic in the pyramid's
resolution.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

import numpy as np

import renderers
from renderers.transport.penumbra.assemble import Construction
from renderers.transport.penumbra.build import LightShadows, Slope, build, warm_up
from renderers.transport.penumbra.emitters import emitters_of


def measured(work: Callable[[], object], repeats: int = 3) -> tuple[float, float]:
    """Median wall and CPU seconds of a call."""
    walls, cpus = [], []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return float(np.median(walls)), float(np.median(cpus))


def main() -> None:
    """Print one line a case."""
    warm_up()
    world = renderers.load_scene("cornell-box", light="area").world()
    lamp = emitters_of(world)[0]
    kept: list[LightShadows] = []
    for samples, resolution, maps in ((16, 128, 128), (64, 128, 128), (64, 256, 128), (64, 256, 256), (256, 256, 256)):
        points = lamp.points(samples, 0)
        for compression in ("none", "vertical", "perpendicular"):
            tally = Counter[str]()

            def work(
                n: int = resolution, m: int = maps, c: str = compression, p: np.ndarray = points, t: Counter[str] = tally
            ) -> None:
                t.clear()
                how = Construction(bias=1e-3, compression=c)  # type: ignore[arg-type]
                kept[:] = [build(world, lamp, p, resolution=n, map_resolution=m, how=how, slope=Slope(), counters=t)]

            wall, cpu = measured(work)
            mib = sum(shadow.bytes for shadow in kept[0].maps) / 2**20
            print(
                f"N {samples:4d}  pyramid {resolution:4d}  map {maps:4d}  {compression:14s} {wall:7.2f} s wall {cpu:7.2f} s CPU "
                f"{tally['texels_walked'] / cpu / 1e6:7.1f} Mtexels/CPU-s  {mib:7.2f} MiB"
            )
    where = world.positions.mean(axis=0) + np.random.default_rng(0).uniform(-0.3, 0.3, (200_000, 3))
    for name in ("nearest", "bilinear"):
        wall, cpu = measured(lambda f=name: kept[0].hidden(where, filter=f))  # type: ignore[misc]
        print(f"lookup {name:9s} {len(where) / wall / 1e6:6.2f} M points/s wall  {len(where) / cpu / 1e6:6.2f} M points/CPU-s")


if __name__ == "__main__":
    main()
