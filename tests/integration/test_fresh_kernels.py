"""Kernels just compiled, kernels loaded from numba's cache, one thread or two: the same bytes of every layer, the same counters."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SIZE = (128, 72)  # where the compiler ordered the sums of 2,048 lights, 1 value of `ir` in 27,648 differed at this size and seed
SCRIPT = """
import hashlib, json, sys
import renderers
name, scene, settings, size, frames = json.loads(sys.argv[1])
method = renderers.get_method(name)
for frame in method.render_frames(renderers.load_scene(scene), method.Settings(**settings), size=size, seed=1, frames=frames):
    print(json.dumps([{k: hashlib.sha256(v.tobytes()).hexdigest() for k, v in frame.layers.items()}, dict(frame.counters)]))
"""
LIGHT = {"vpls": 2048, "backend": "cpu"}
CASES: dict[str, tuple[str, str, dict[str, Any], tuple[int, int]]] = {
    "ir": ("ir", "cornell-box", LIGHT, (0, 0)),
    "ir glossy": ("ir", "cornell-glossy", LIGHT, (0, 0)),
    "ir occluded": ("ir", "cornell-box", LIGHT | {"vpls": 64, "visibility": "raycast"}, (0, 0)),
    "flc": ("flc", "cornell-box", LIGHT, (0, 0)),
    "flc ridge, interleaved": ("flc", "cornell-box", LIGHT | {"family": "ridge", "interleave": 2}, (0, 0)),
    "flc glossy": ("flc", "cornell-glossy", LIGHT, (0, 0)),
    "trc": ("trc", "cornell-box", {"rays": 64, "backend": "cpu"}, (0, 1)),
    "rcs glossy": ("rcs", "cornell-glossy", {"rays": 64, "backend": "cpu"}, (0, 0)),
}


def rendered(folder: Path, threads: int, case: tuple[str, str, dict[str, Any], tuple[int, int]]) -> list[str]:
    """Hashes of layers, and counters, a line a frame, from a process whose kernels lie in `folder`."""
    name, scene, settings, frames = case
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder), "NUMBA_NUM_THREADS": str(threads), "PYTHONPATH": str(ROOT)}
    asked = json.dumps([name, scene, settings, SIZE, frames])
    done = subprocess.run([sys.executable, "-c", SCRIPT, asked], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.parametrize("case", ["ir", *(pytest.param(c, marks=pytest.mark.slow) for c in CASES if c != "ir")])
def test_a_first_process_gives_the_bytes_of_all_later_ones(tmp_path: Path, case: str) -> None:
    first = rendered(tmp_path, 2, CASES[case])
    assert any(tmp_path.rglob("*.nbc"))  # kernels were compiled, and kept
    assert first == rendered(tmp_path, 1, CASES[case])
    assert len(first) == 1 + CASES[case][3][1]
