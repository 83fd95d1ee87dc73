"""Photon maps and records made of them: photons per second, milliseconds a record, frames of a walkthrough, and against triangles.

Run on an idle machine: `python -m benchmarks.pmic`. Medians of three repeats; wall seconds depend on the cores.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np

import renderers
from benchmarks.shared.clock import measured
from renderers.methods.pmic import PhotonMappedIrradianceCaching, PmicSettings, recipe_of, warm_up
from renderers.scene.world import World
from renderers.transport.photons.map import photon_map
from renderers.transport.photons.tracing import Traced, trace
from renderers.transport.photons.walk import walk


def split(world: World) -> World:
    """The same surfaces with every triangle in four."""
    t, p = world.triangles, world.positions
    attributes = (p, world.normals, world.uvs)
    middles = [[(a[t[:, i]] + a[t[:, (i + 1) % 3]]) / 2 for i in range(3)] for a in attributes]
    n, count = len(p), len(t)
    ab, bc, ca = (n + np.arange(count) + k * count for k in range(3))
    corners = [(t[:, 0], ab, ca), (ab, t[:, 1], bc), (ca, bc, t[:, 2]), (ab, bc, ca)]
    columns = [np.concatenate([a, *m]).astype(np.float32) for a, m in zip(attributes, middles, strict=True)]
    return replace(
        world, positions=columns[0], normals=columns[1], uvs=columns[2],
        triangles=np.concatenate([np.stack(c, axis=1) for c in corners]).astype(np.int32),
        material=np.tile(world.material, 4), instance=np.tile(world.instance, 4),
    )  # fmt: skip


def records(world: World, label: str, emitted: int) -> None:
    """Trace, build and walk one scene; print what each costs."""
    settings = PmicSettings(photons=emitted)
    traced: list[Traced] = []
    wall, cpu = measured(lambda: traced.append(trace(world, emitted, seed=1)))
    tree_wall, tree_cpu = measured(lambda: photon_map(traced[-1]))
    photons, counters = photon_map(traced[-1]), Counter[str]()
    recipe = recipe_of(world, photons, settings)
    walk_wall, walk_cpu = measured(lambda: walk(world, photons, recipe))
    walk(world, photons, recipe, counters=counters)
    count = counters["records"]
    print(
        f"{label}, {len(world.triangles)} triangles: {len(photons)} photons stored: trace {wall:.2f} s ({cpu:.2f} s CPU), tree "
        f"{tree_wall:.2f} s ({tree_cpu:.2f} s CPU); {count} records in {walk_wall:.2f} s ({walk_cpu:.2f} s CPU), "
        f"{walk_wall / count * 1e3:.3f} ms each ({walk_cpu / count * 1e3:.3f} ms CPU)"
    )


def main() -> None:
    """Print one line a case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photons", type=int, default=500_000, help="emitted")
    photons = parser.parse_args().photons
    world = renderers.load_scene("cornell-box").world()
    warm_up(world)
    records(world, "cornell-box", photons)
    finer = world
    for _ in range(4):
        finer = split(finer)
    records(finer, "cornell-box, every triangle in 256", photons)
    scene, method = renderers.load_scene("cornell-box"), PhotonMappedIrradianceCaching()
    frames = method.walkthrough(scene, None, [world.camera] * 4, size=(1280, 720))
    for timing in frames[-1].timings:
        print(f"walkthrough frame 1280x720, {timing.name}: {timing.wall_s * 1e3:.0f} ms ({timing.cpu_s * 1e3:.0f} ms CPU)")


if __name__ == "__main__":
    main()
