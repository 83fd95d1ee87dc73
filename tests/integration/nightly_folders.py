"""Disturbs copies of evaluation folders, for tests of what a comparison sees."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from report_evaluation import METHODS, truth

from renderers.images import read_exr, write_exr
from reports.folder import read

Change = Callable[[np.ndarray], np.ndarray]


def copy(folder: Path, to: Path) -> Path:
    """A copy of an evaluation folder without its report."""
    shutil.copytree(folder, to)
    return to


def change_images(folder: Path, pattern: str, change: Change) -> None:
    """Replace the images of the cells that match; their hashes follow, their stored metrics stay behind."""
    for path in sorted((folder / "images").glob(f"{pattern}.exr")):
        image = np.asarray(change(read_exr(path)[0]["beauty"]), np.float32)
        write_exr(path, {"beauty": image}, default="beauty")
        _edit(folder, path.stem, {"frame_hash": hashlib.sha256(image.tobytes()).hexdigest()})


def change_counters(folder: Path, pattern: str, change: Callable[[dict[str, int]], dict[str, int]]) -> None:
    """Replace the work counts of the cells that match, and their hashes, which cover the counts."""
    for path in sorted((folder / "results").glob(f"{pattern}.json")):
        counters = change(json.loads(path.read_text())["counters"])
        _edit(folder, path.stem, {"counters": counters, "frame_hash": hashlib.sha256(str(counters).encode()).hexdigest()})


def redraw(folder: Path, seed: int) -> None:
    """Other random numbers for every image, from the same distribution: what an equally good sampler would do."""
    rng = np.random.default_rng(seed)
    evaluation, _ = read(folder)
    scenes = [scene.name for scene in evaluation.scenes]
    sigma = {label: (noise, bias) for _, label, _, _, noise, bias, _ in METHODS}
    for cell in evaluation.cells:
        noise, bias = sigma[cell.label]
        image = truth(scenes.index(cell.scene), cell.frame, cell.transport, (cell.width, cell.height)) * bias
        change_images(folder, cell.id, lambda _, i=image, n=noise: np.maximum(i * (1 + n * rng.standard_normal(i.shape)), 0))


def fail(folder: Path, pattern: str, error: str = "killed by SIGABRT") -> None:
    """Make the cells that match failed ones."""
    document = json.loads((folder / "evaluation.json").read_text())
    for path in sorted((folder / "results").glob(f"{pattern}.json")):
        path.unlink()
        cell = next(c for c in document["cells"] if c["id"] == path.stem)
        cell |= {"state": "failed", "error": error}
    (folder / "evaluation.json").write_text(json.dumps(document))


def _edit(folder: Path, cell: str, fields: dict[str, object]) -> None:
    path = folder / "results" / f"{cell}.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))
