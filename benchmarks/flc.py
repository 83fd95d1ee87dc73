"""Forward light cuts beside instant radiosity: `python -m benchmarks.flc`. Pairs, CPU seconds, pairs per CPU-second, and ratios.

Pairs are those computed, in tiles of 8 × 8 pixels that a support reaches.
"""

from __future__ import annotations

from typing import Any

import renderers
from renderers.frame import Frame

SIZE = (320, 180)
REPEATS = 3
CASES: list[tuple[str, dict[str, Any]]] = [
    ("ir", {}),
    ("flc", {"levels": 1}),
    ("flc", {}),
    ("flc", {"family": "c0", "reach": 0.5}),
    ("flc", {"family": "ridge", "reach": 0.5}),
    ("flc", {"reach": 0.1}),
    ("flc", {"interleave": 4}),
    ("flc", {"backend": "gl"}),
    ("lightcuts-solid-angle", {}),
    ("stochastic-lightcuts", {}),
]


def seconds(frame: Frame) -> float:
    """CPU seconds of the bounce alone."""
    return sum(t.cpu_s for t in frame.timings if t.name in ("gather", "splat", "tree", "cuts"))


def main() -> None:
    """Print one line a scene and method: the least of REPEATS runs, methods taken in turn."""
    for name in ("empty-room", "cornell-box", "colonnade"):
        scene, best = renderers.load_scene(name), dict[int, Frame]()
        for _ in range(REPEATS):
            for index, (kind, settings) in enumerate(CASES):
                method = renderers.get_method(kind)
                frame = method.render(scene, method.Settings(vpls=16384, **settings), size=SIZE, seed=1)
                if index not in best or seconds(frame) < seconds(best[index]):
                    best[index] = frame
        for index, (kind, settings) in enumerate(CASES):
            counters, took = best[index].counters, seconds(best[index])
            pairs = counters["light_evaluations"]
            print(
                f"{name} {kind} {settings}: {took:.3f} CPU s, {pairs / 1e6:.1f} M pairs, {pairs / took / 1e6:.0f} M/CPU s, "
                f"{counters.get('pixels_touched', 0) / 1e6:.1f} M lit, {took / seconds(best[0]):.2f} of ir's time",
                flush=True,
            )


if __name__ == "__main__":
    main()
