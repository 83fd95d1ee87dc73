"""Images of an evaluation folder: the frames of cells, and the references they are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from renderers.images import read_exr
from reports.folder import Cell, Evaluation, ReferenceInfo
from reports.metrics import Pair

DEBUG = "debug."
CAPTION = "caption."  # an EXR attribute caption.<layer> says what a diagnostic picture shows


@dataclass(frozen=True, eq=False)
class Picture:
    """A diagnostic picture of a method (layer `debug.<name>`): linear colours 0..1, float32 (H, W, 3), and what they mean."""

    name: str
    caption: str
    pixels: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class StoredReference:
    """A reference as stored: mean and variance float32 (H, W, 3), luminance_variance float32 (H, W), n replicates."""

    info: ReferenceInfo
    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    luminance_variance: NDArray[np.float32]

    def pair(self, test: NDArray[np.float32], exposure: float) -> Pair:
        """A test image beside this reference and its noise."""
        return Pair(test, self.mean, exposure, self.luminance_variance, self.info.replicates)


class Images:
    """Reads images on demand and keeps the references of the scene at hand in memory."""

    def __init__(self, folder: Path, evaluation: Evaluation) -> None:
        self.folder = folder
        self._infos = evaluation.references
        self._references: dict[str, StoredReference | None] = {}

    def frame(self, cell: Cell) -> NDArray[np.float32] | None:
        """Beauty of a cell, float32 (H, W, 3); None when the folder doesn't hold it."""
        path = self.folder / "images" / f"{cell.id}.exr"
        return read_exr(path)[0]["beauty"] if path.is_file() else None

    def pictures(self, cell: Cell) -> list[Picture]:
        """Diagnostic pictures that a cell's method drew, by name."""
        path = self.folder / "images" / f"{cell.id}.exr"
        return read_pictures(path) if path.is_file() else []

    def reference(self, scene: str, frame: int, transport: str, size: tuple[int, int]) -> StoredReference | None:
        """The pixel-centre reference of a scene, frame, transport and size (width, height); None when there is none."""
        for info in self._infos:
            if (info.scene, info.frame, info.transport, info.pixel) == (scene, frame, transport, "centre"):
                found = self.stored(info)
                if found is not None and found.mean.shape[:2] == size[::-1]:
                    return found
        return None

    def forget(self) -> None:
        """Free the references read so far."""
        self._references.clear()

    def stored(self, info: ReferenceInfo) -> StoredReference | None:
        """The reference that an info names; None when the folder does not hold it."""
        if info.id not in self._references:
            path = self.folder / "references" / f"{info.id}.exr"
            self._references[info.id] = _read_reference(info, path) if path.is_file() else None
        return self._references[info.id]


def read_pictures(path: Path) -> list[Picture]:
    """Diagnostic pictures of an image file, by name."""
    layers, attributes = read_exr(path)
    named = sorted((name.removeprefix(DEBUG), name) for name in layers if name.startswith(DEBUG))
    return [Picture(short, attributes[f"{CAPTION}{name}"], layers[name]) for short, name in named]


def _read_reference(info: ReferenceInfo, path: Path) -> StoredReference:
    layers, _ = read_exr(path)
    return StoredReference(info, layers["mean"], layers["variance"], layers["luminance_variance"])
