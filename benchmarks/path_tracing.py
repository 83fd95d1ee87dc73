"""Paths per second of the reference renderer, by transport: `python -m benchmarks.path_tracing [SCENE] [WIDTH HEIGHT]`."""

from __future__ import annotations

import sys
from functools import partial

import renderers
from benchmarks.shared.clock import measured
from renderers.reference.export import mitsuba_scene
from renderers.reference.sampling import CENTRE, mean_image, reference_stream
from renderers.reference.transports import estimator

SPP = 64
REPEATS = 3


def main() -> None:
    """Print one line a transport: the median of a few runs, after one that compiles the kernels."""
    name = sys.argv[1] if len(sys.argv) > 1 else "cornell-box"
    size = (int(sys.argv[2]), int(sys.argv[3])) if len(sys.argv) > 3 else (320, 180)
    world = renderers.load_scene(name).world()
    for transport in renderers.TRANSPORTS:
        scene = mitsuba_scene(world, size, clay=transport == "ambient-occlusion")
        estimate = estimator(transport, scene)
        mean_image(scene, estimate, size, SPP, reference_stream(0), CENTRE, active=False)
        work = partial(mean_image, scene, estimate, size, SPP, reference_stream(1), CENTRE)
        wall, cpu = measured(work, REPEATS)
        paths = size[0] * size[1] * SPP
        print(f"{name} {transport:24} {paths / wall:12,.0f} paths/s {paths / cpu:12,.0f} paths/cpu-s")


if __name__ == "__main__":
    main()
