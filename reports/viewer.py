"""Data of the image viewer: floats as they are, in scripts that a page opened from disk may load (it may not fetch files).

`<assets>/data/<id>.js` calls `luxmeter.image(id, {width, height, rgb, over})`: rgb is base64 of little-endian float32 (H, W, 3),
row 0 on top; `over` maps a reference's id to base64 of one byte a pixel (0 within 2 %, 1 surely over, 2 undecided).
`<assets>/pictures/<id>.<name>.png` is a diagnostic picture that the method drew beside the image.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from renderers.images import luminance, write_png
from reports.folder import Cell, SceneInfo
from reports.metrics import over_states
from reports.rows import Row
from reports.sequences import compared, worst
from reports.stored import Images, StoredReference

MOST_FRAMES = 8
MOST_OF_A_SEQUENCE = 24
MOST_PIXELS = 6_000_000  # of a sequence, 16 bytes each in the scripts
DIFFERENCE_RANGE = 0.25


def shown_frames(frames: Sequence[int], most: int = MOST_FRAMES) -> list[int]:
    """All frames, or of many the first, the last and evenly spaced ones between them, at most 8."""
    if len(frames) <= most:
        return list(frames)
    picks = np.linspace(0, len(frames) - 1, most).round().astype(int)
    return [frames[i] for i in picks]


def chosen_frames(rows: Sequence[Row]) -> list[int]:
    """Frames of the viewer: of those that have references the shown ones, more of small images, and each row's worst frame."""
    frames = sorted({f for row in rows for f in compared(row)}) or sorted({f for row in rows for f in row.frames})
    pixels = sum(3 * row.size[0] * row.size[1] for row in rows)  # an image and two references
    most = min(max(MOST_PIXELS // pixels, MOST_FRAMES), MOST_OF_A_SEQUENCE) if rows else MOST_FRAMES
    return sorted({*shown_frames(frames, most), *(cell.frame for row in rows if (found := worst(row)) for cell in found[:1])})


def write_viewer(images: Images, scene: SceneInfo, rows: Sequence[Row], assets: Path, prefix: str) -> dict[str, Any]:
    """Write a scene's image scripts and thumbnails under `assets`; returns what the page needs to know of them."""
    (assets / "data").mkdir(exist_ok=True)
    (assets / "thumbnails").mkdir(exist_ok=True)
    frames = []
    for frame in chosen_frames(rows):
        entries = _Frame(images, scene, frame, assets, prefix)
        for row in rows:
            first = next((c for c, _ in row.done if c.frame == frame), None)
            if first is not None:
                entries.add_row(row, first)
        if entries.entries:
            frames.append({"frame": frame, "images": entries.entries})
    return {"exposure": scene.exposure, "frames": frames}


class _Frame:
    """Images of one frame of a scene: references once each, then the methods."""

    def __init__(self, images: Images, scene: SceneInfo, frame: int, assets: Path, prefix: str) -> None:
        self.images, self.scene, self.frame, self.assets, self.prefix = images, scene, frame, assets, prefix
        self.entries: list[dict[str, Any]] = []
        self._references: dict[str, str] = {}

    def add_row(self, row: Row, cell: Cell) -> None:
        pixels = self.images.frame(cell)
        if pixels is None:
            return
        own: dict[str, str] = {}
        over: dict[str, str] = {}
        for against, transport in (("matched", row.transport), ("full", "full")):
            stored = self.images.reference(self.scene.name, self.frame, transport, row.size)
            if stored is not None and stored.mean.shape == pixels.shape:
                own[against] = self._reference(stored)
                over[own[against]] = encode(over_states(stored.pair(pixels, self.scene.exposure)))
        key = f"{self.prefix}-{row.key}-f{self.frame}"
        self._write(key, row.label, pixels, over, {"kind": "method", "pictures": self._pictures(key, cell), **own})

    def _pictures(self, key: str, cell: Cell) -> list[dict[str, str]]:
        """Write the diagnostic pictures that the method drew; their files, names and captions."""
        found = []
        for picture in self.images.pictures(cell):
            file = f"{key}.{picture.name}.png"
            (self.assets / "pictures").mkdir(exist_ok=True)
            write_png(self.assets / "pictures" / file, picture.pixels, exposure=1.0)
            found.append({"file": file, "name": picture.name.replace("-", " "), "caption": picture.caption})
        return found

    def _reference(self, stored: StoredReference) -> str:
        if stored.info.id not in self._references:
            key = f"{self.prefix}-reference{len(self._references)}-f{self.frame}"
            self._references[stored.info.id] = key
            label = f"reference, {stored.info.transport}"
            self._write(key, label, stored.mean, {}, {"kind": "reference"})
        return self._references[stored.info.id]

    def _write(self, key: str, label: str, pixels: NDArray[np.float32], over: Mapping[str, str], more: Mapping[str, Any]) -> None:
        height, width = pixels.shape[:2]
        data = {"width": width, "height": height, "rgb": encode(pixels.astype("<f4")), "over": dict(over)}
        (self.assets / "data" / f"{key}.js").write_text(f"luxmeter.image({json.dumps(key)},{json.dumps(data)});\n")
        write_png(self.assets / "thumbnails" / f"{key}.png", pixels, self.scene.exposure)
        self.entries.append({"id": key, "label": label, "width": width, "height": height, **more})


def write_difference(path: Path, test: NDArray[np.float32], other: NDArray[np.float32]) -> None:
    """Write a PNG of the signed relative difference of luminance, (test − other) / (other + 1 % of its mean), as the viewer does:
    blue where `test` is darker by 25 % or more, light grey where both are equal, orange where it is brighter by 25 % or more.
    """
    luma = luminance(other)
    floor = luma + 0.01 * luma.mean()
    apart = luminance(test) - luma
    relative = np.divide(apart, floor, out=np.sign(apart), where=floor > 0)
    scaled = np.clip(relative / DIFFERENCE_RANGE, -1, 1)[..., None]
    ends = np.where(scaled < 0, (0, 90, 181), (200, 80, 0))
    Image.fromarray((242 + (ends - 242) * abs(scaled)).round().astype(np.uint8)).save(path, "png")


def encode(array: NDArray[Any]) -> str:
    """Base64 of the array's bytes in row order."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
