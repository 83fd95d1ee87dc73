"""Forward light cuts beside instant radiosity on the CPU: `python -m benchmarks.flc`. Pairs lit, seconds, and their ratios."""

from __future__ import annotations

import renderers
from renderers.frame import Frame

SIZE = (320, 180)
REPEATS = 3


def seconds(frame: Frame) -> float:
    """CPU seconds of the bounce alone."""
    return sum(t.cpu_s for t in frame.timings if t.name in ("gather", "splat", "tree", "cuts"))


def main() -> None:
    """Print one line a scene and method: the least of REPEATS runs, methods taken in turn."""
    cases = [
        ("ir", {}), ("flc", {"levels": 1}), ("flc", {}), ("flc", {"family": "ridge"}), ("flc", {"reach": 0.2}),
        ("flc", {"interleave": 4}), ("lightcuts-solid-angle", {}), ("stochastic-lightcuts", {}),
    ]  # fmt: skip
    for name in ("empty-room", "cornell-box", "colonnade"):
        scene, best = renderers.load_scene(name), dict[int, Frame]()
        for _ in range(REPEATS):
            for index, (kind, settings) in enumerate(cases):
                method = renderers.get_method(kind)
                frame = method.render(scene, method.Settings(vpls=16384, **settings), size=SIZE, seed=1)
                if index not in best or seconds(frame) < seconds(best[index]):
                    best[index] = frame
        for index, (kind, settings) in enumerate(cases):
            counters = best[index].counters
            print(
                f"{name} {kind} {settings}: {seconds(best[index]):.3f} CPU s, "
                f"{counters['light_evaluations'] / 1e6:.1f} M evaluations, "
                f"{counters.get('pixels_touched', 0) / 1e6:.1f} M lit, {seconds(best[index]) / seconds(best[0]):.2f} of ir's time"
            )


if __name__ == "__main__":
    main()
