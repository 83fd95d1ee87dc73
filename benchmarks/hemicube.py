"""Times records of irradiance: polar hemispheres by rays, hemicubes drawn by OpenGL, at several numbers of triangles and texels.

    python -m benchmarks.hemicube [--triangles 1000 100000 1000000] [--sizes 32 64 128] [--records 64] [--repeats 3]

Prints medians of milliseconds a record, wall and CPU (all threads), without building of trees, upload and shadow maps: `polar` with
as many rays as the hemicube has texels, `hemicube, cast` with shadow rays, `hemicube, mapped` with shadow maps. Measure on an idle
machine.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.shared.clock import measured
from renderers.gl.device import device_string
from renderers.gl.hemicube import LitHemicubes, Triangles
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, PointLight
from renderers.scene.shapes import sphere
from renderers.scene.world import World
from renderers.transport.caching.hemicube import HemicubeSampler
from renderers.transport.caching.hemisphere import PolarSampler, grid_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import OFFSET


def room_with_ball(triangles: int) -> World:
    """A box-shaped room with a lamp, and a ball of about so many triangles in it."""
    b = SceneBuilder("room-with-ball")
    white = b.material(Lambert("white", (0.7, 0.7, 0.7)))
    low, high = np.array([-2.0, 0.0, -2.0]), np.array([2.0, 3.0, 2.0])
    for axis in range(3):
        for side in (low, high):
            u, v = (np.eye(3)[(axis + k) % 3] * (high - low) for k in (1, 2))
            start = np.where(np.arange(3) == axis, side, low)
            b.quad([start, start + u, start + u + v, start + v], white)
    rings = max(2, round(float(np.sqrt(triangles / 4))))
    positions, normals, faces = sphere(0.8, 2 * rings, rings)
    b.node(meshes=(b.mesh(positions, faces, white, normals),), translation=(0.2, 1.0, 0.0))
    b.light(PointLight("lamp", intensity=5.0), (-1.2, 2.5, 1.0))
    b.camera((-1.5, 1.7, 1.8), (0.3, 0.8, 0), 1.2)
    return b.build().world()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--triangles", type=int, nargs="+", default=(1_000, 100_000, 1_000_000))
    parser.add_argument("--sizes", type=int, nargs="+", default=(32, 64, 128), help="texels along a face's side")
    parser.add_argument("--records", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    print(device_string())
    for triangles in options.triangles:
        world = room_with_ball(triangles)
        gbuffer = cast_gbuffer(world, (64, 48))
        rows = np.linspace(0, np.count_nonzero(gbuffer.covered) - 1, options.records).astype(int)
        sites = Sites(*receivers_of(world, gbuffer, np.flatnonzero(gbuffer.covered)[rows]))
        for size in options.sizes:
            compare(world, sites, size, options.repeats)


def compare(world: World, sites: Sites, size: int, repeats: int) -> None:
    """Print three lines: milliseconds a record, and how far irradiance is from that of a polar hemisphere of 65,536 rays (RMS)."""
    incoming, count = ReflectedDirectLight(world), len(sites.position)
    exact = PolarSampler(world, grid_of(65536), incoming)(sites).irradiance
    samplers = {
        "polar": PolarSampler(world, grid_of(3 * size * size), incoming),
        "hemicube, cast": HemicubeSampler(world, size, incoming, rasteriser=Triangles(world, OFFSET)),
        "hemicube, mapped": HemicubeSampler(world, size, incoming, rasteriser=LitHemicubes(world, OFFSET)),
    }
    for name, sampler in samplers.items():
        found = sampler(sites).irradiance
        wall, cpu = (1e3 * seconds / count for seconds in measured(lambda s=sampler: s(sites), repeats))  # type: ignore[misc]
        error = np.sqrt(np.mean((found - exact) ** 2)) / exact.mean()
        print(
            f"{len(world.triangles):>9,} triangles  {size:>3}²  {name:<17}{wall:9.3f} ms wall{cpu:9.3f} ms CPU  off by {error:.4f}"
        )


if __name__ == "__main__":
    main()
