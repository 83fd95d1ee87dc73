"""Moving pictures of a sequence: all its methods side by side as one animated image, which keeps them in step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, features

from renderers.images import display_values
from reports.folder import SceneInfo
from reports.rows import Row
from reports.stored import Images

MOST_FRAMES = 600
MOST_BYTES = 96 << 20  # of the decoded frames, which the encoder holds at once
TILE = 320  # most pixels of a tile's longer side; small images are enlarged up to it by whole factors
COLUMNS = 3

Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Preview:
    """File name, size in pixels, labels of its tiles line by line, how many tiles a line has, and what is shown of the frames."""

    file: str
    width: int
    height: int
    labels: tuple[str, ...]
    columns: int
    first: int
    last: int
    step: int


def write_preview(images: Images, scene: SceneInfo, rows: Sequence[Row], stem: Path) -> Preview | None:
    """Write `<stem>.webp` (`.png` where Pillow has no WebP) of the first seeds' frames, in the scene's speed.

    A matched reference stands beside them where every frame has one. None where no row has two frames, or an image is missing.
    """
    rows = [row for row in rows if len(row.frames) > 1]
    if not rows:
        return None
    frames = sorted(set.intersection(*(set(row.frames) for row in rows)))
    step = math.ceil(len(frames) / MOST_FRAMES)
    frames = frames[::step]
    sources: list[tuple[str, Callable[[int], Pixels | None]]] = [(row.label, _frames_of(images, row)) for row in rows]
    if all(_reference(images, scene, rows[0], frame) is not None for frame in frames):
        sources.append((f"reference, {rows[0].transport}", lambda frame: _reference(images, scene, rows[0], frame)))
    pictures = []
    columns = min(len(sources), COLUMNS)
    width, height = rows[0].size
    scale = _scale(width, height, columns * math.ceil(len(sources) / columns) * len(frames))
    tile = max(round(width * scale), 1), max(round(height * scale), 1)
    for frame in frames:
        tiles = [source(frame) for _, source in sources]
        known = [pixels for pixels in tiles if pixels is not None]
        if len(known) < len(tiles):
            return None
        pictures.append(_grid([_shown(pixels, scene.exposure, tile) for pixels in known], columns))
    if len(pictures) < 2:
        return None
    path = stem.with_suffix(".webp" if features.check("webp") else ".png")
    duration = max(round(1000 * step / scene.fps), 1)
    more: dict[str, Any] = {"quality": 88, "method": 3} if path.suffix == ".webp" else {}
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=duration, loop=0, **more)
    labels = tuple(label for label, _ in sources)
    return Preview(path.name, *pictures[0].size, labels, columns, frames[0], frames[-1], step)


def _frames_of(images: Images, row: Row) -> Callable[[int], Pixels | None]:
    """Reads the row's image of a frame, of its first seed."""
    cells = {cell.frame: cell for cell, _ in reversed(row.done)}
    return lambda frame: images.frame(cells[frame])


def _reference(images: Images, scene: SceneInfo, row: Row, frame: int) -> Pixels | None:
    found = images.reference(scene.name, frame, row.transport, row.size)
    return None if found is None else found.mean


def _scale(width: int, height: int, tiles: int) -> float:
    """Factor of a tile's size: enlarged by a whole number, or made smaller where it or all tiles together are too large."""
    fits = TILE / max(width, height)
    affordable = math.sqrt(MOST_BYTES / (3 * width * height * tiles))
    scale = min(fits, affordable)
    return math.floor(scale) if scale >= 1 else scale


def _shown(pixels: Pixels, exposure: float, size: tuple[int, int]) -> Image.Image:
    picture = Image.fromarray(np.rint(display_values(pixels, exposure)).astype(np.uint8))
    if picture.size == size:
        return picture
    return picture.resize(size, Image.Resampling.NEAREST if size[0] > picture.width else Image.Resampling.BOX)


def _grid(tiles: Sequence[Image.Image], columns: int) -> Image.Image:
    width, height = tiles[0].size
    grid = Image.new("RGB", (columns * width, math.ceil(len(tiles) / columns) * height))
    for index, tile in enumerate(tiles):
        grid.paste(tile.resize((width, height)), (index % columns * width, index // columns * height))
    return grid
