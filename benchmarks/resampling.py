"""Point resampling against the number of triangles: `python -m benchmarks.resampling [--backends cpu gl]`.

The colonnade at 20 thousand, 200 thousand and 2 million triangles, the same number of points: CPU milliseconds of a frame (all
threads, medians, "prepare" passes left out) and of its passes, and how much the frame grows. Then the same while one piece of it
moves, everything counted: triangles are flattened and uploaded anew, and the ray caster is built anew, in every frame.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from dataclasses import replace

import numpy as np

import renderers
from renderers.scene.model import Channel, Scene

TRIANGLES = (20_000, 200_000, 2_000_000)
SIZE = (192, 108)


def moving(scene: Scene) -> Scene:
    """The scene with its last piece moving by a centimetre a frame."""
    piece = max(index for index, node in enumerate(scene.nodes) if node.meshes)
    start = np.array(scene.nodes[piece].translation)
    keys = np.array([0.0, 10.0]), np.stack([start, start + np.array([10 * 0.01 * scene.fps, 0, 0])])
    return replace(scene, channels=(Channel("node", piece, "translation", *keys),))


def passes(scene: Scene, name: str, settings: dict[str, object], repeats: int, everything: bool) -> dict[str, float]:
    """Median CPU milliseconds of each pass over frames 1, 2, …; everything: "prepare" ones and the rest of the frame too."""
    method, spent = renderers.get_method(name), defaultdict[str, list[float]](list)
    for index in range(repeats + 1):
        start = time.process_time()
        frame = method.render(scene, method.Settings(sampler="resampled", **settings), size=SIZE, seed=1, frame=index)
        total = time.process_time() - start
        if index == 0:
            continue
        for timing in frame.timings:
            if everything or timing.stage == "render":
                spent[timing.name].append(timing.cpu_s * 1e3)
        if everything:
            spent["flatten and all else"].append((total - sum(t.cpu_s for t in frame.timings)) * 1e3)
    return {part: float(np.median(times)) for part, times in spent.items()}


def main() -> None:
    """Print one line a size, method and backend."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="+", default=["cpu", "gl"], choices=["cpu", "gl"])
    parser.add_argument("--points", type=int, default=4096)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    first: dict[object, float] = {}
    for count in TRIANGLES:
        still = renderers.load_scene("colonnade", triangles=count)
        for scene in (still, moving(still)):
            for name in ("ir", "flc"):
                for backend in options.backends:
                    moves = scene is not still
                    found = passes(scene, name, {"vpls": options.points, "backend": backend}, options.repeats, moves)
                    total = sum(found.values())
                    growth = total / first.setdefault((name, backend, moves), total)
                    parts = ", ".join(f"{part} {ms:.0f}" for part, ms in found.items())
                    print(
                        f"{len(scene.world().triangles):>9,} triangles, {'moving, ' * moves}{name} on {backend}: "
                        f"{total:.0f} ms, {growth:.2f} times the first; {parts}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
