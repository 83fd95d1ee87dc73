"""Times the GL passes: G-buffer at 70 thousand and 1 million triangles, shadow map, and the gather's pixel-lights per CPU-second.

    python -m benchmarks.gl [--gather-size 1024 1024] [--lights 1024] [--repeats 5]

Prints medians of wall and CPU milliseconds (all threads; GPU too where there is one), warm-up excluded. Measure on an idle machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from renderers.frame import Stopwatch, Timing
from renderers.gl.device import device_string
from renderers.gl.gather import gather
from renderers.gl.gbuffer import render_resident
from renderers.gl.lights import light_samples
from renderers.gl.shadow import shadow_map
from renderers.gl.timers import timed
from renderers.scene.builder import SceneBuilder
from renderers.scene.load import load_scene
from renderers.scene.model import Lambert, PointLight
from renderers.scene.shapes import sphere
from renderers.scene.world import World


def ball(rings: int) -> World:
    """One sphere of 4 · rings · (rings - 1) triangles over a floor."""
    b = SceneBuilder("ball")
    material = b.material(Lambert())
    positions, normals, triangles = sphere(1.0, 2 * rings, rings)
    b.node(meshes=(b.mesh(positions, triangles, material, normals),))
    b.quad([(-3, -1, 3), (3, -1, 3), (3, -1, -3), (-3, -1, -3)], material)
    b.light(PointLight("lamp", intensity=5.0), (2, 3, 2))
    b.camera((0, 0.5, 4), (0, 0, 0), 0.7)
    return b.build().world()


def median(work: Callable[[], object], repeats: int) -> Timing:
    """Median wall and CPU seconds of `work` after one call that is not counted."""
    work()
    timings = []
    for _ in range(repeats):
        watch = Stopwatch()
        with timed(watch, "pass"):
            work()
        timings += watch.timings
    gpu = [t.gpu_s for t in timings if t.gpu_s is not None]
    return Timing(
        "pass", float(np.median([t.wall_s for t in timings])), float(np.median([t.cpu_s for t in timings])),
        float(np.median(gpu)) if gpu else None,
    )  # fmt: skip


def line(name: str, timing: Timing) -> str:
    """One row of the table."""
    gpu = "" if timing.gpu_s is None else f"  {timing.gpu_s * 1e3:8.2f} ms GPU"
    return f"{name:<40} {timing.wall_s * 1e3:9.1f} ms wall {timing.cpu_s * 1e3:9.1f} ms CPU{gpu}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, nargs=2, default=(512, 512), help="of the G-buffer, pixels")
    parser.add_argument("--gather-size", type=int, nargs=2, default=(1024, 1024), help="of the gather's G-buffer, pixels")
    parser.add_argument("--lights", type=int, default=1024)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    print(device_string())
    for rings in (133, 500):
        world_passes(ball(rings), (options.size[0], options.size[1]), options.repeats)
    gather_rate((options.gather_size[0], options.gather_size[1]), options.lights, options.repeats)


def world_passes(world: World, size: tuple[int, int], repeats: int) -> None:
    """Print the passes whose cost follows the triangles."""
    count, lamp = f"{len(world.triangles):,} triangles", light_samples(world, 1)[0]
    print(line(f"G-buffer, {count}", median(lambda: render_resident(world, size).release(), repeats)))
    print(line(f"cube shadow map 1024, {count}", median(lambda: shadow_map(world, lamp).release(), repeats)))


def gather_rate(size: tuple[int, int], count: int, repeats: int) -> None:
    """Print the gather pass, read-back included."""
    world = load_scene("cornell-box").world()
    rng = np.random.default_rng(0)
    lights = rng.normal(size=(3, count, 3)).astype(np.float32) / 2
    resident = render_resident(world, size)
    pairs = int(resident.read().covered.sum()) * count
    timing = median(lambda: gather(resident, world, *lights, 1e-4), repeats)
    print(line(f"gather, {pairs:,} pixel-lights", timing))
    rate = pairs / timing.cpu_s / 1e6
    print(f"{rate:.0f} M pixel-lights per CPU-second, {pairs / timing.wall_s / 1e6:.0f} M per second of wall time")


if __name__ == "__main__":
    main()
