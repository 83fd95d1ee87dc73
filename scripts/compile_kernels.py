"""Compile the kernels of all methods ahead, into the folder where numba keeps them: `python scripts/compile_kernels.py`.

A fresh clone compiles for two minutes of one core in all, each kernel when it is first called. `make test` has this script do it on
the core that the tests leave idle.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from renderers import load_scene, registered_methods  # noqa: E402

SCENE, SIZE, FRAMES = "cornell-glossy", (16, 12), (0, 1)
# Those that take longest to compile come first, and of them those whose own tests run late.
FIRST = ("rcs", "trc", "stochastic-lightcuts", "pmic", "pdsm")
WITHOUT = ("pt",)  # Mitsuba's
# Choices that call kernels which the defaults don't.
MORE = {
    "rcs": [{"sampler": "hemicube"}, {"sampler": "plane"}, {"bounces": "all"}],
    "pmic": [{"records": "gather"}],
    "dss": [{"interleave": 2}],
}


def main() -> int:
    """Render two tiny frames with each method; exit code 0."""
    methods = {name: method for name, method in registered_methods().items() if name not in WITHOUT}
    for name in dict.fromkeys((*FIRST, *methods)):
        for choices in ({}, *MORE.get(name, [])):
            settings = methods[name].Settings(**choices)
            for _ in methods[name].render_frames(load_scene(SCENE), settings, size=SIZE, frames=FRAMES):
                pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
