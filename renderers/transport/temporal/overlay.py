"""Where records lie and how long they live, as a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA
from renderers.scene.world import WorldCamera
from renderers.transport.temporal.records import Timed

DIMMED = 0.25
NEAR = 0.02  # distance from the pixel's surface, over the distance from the eye, at which a record is taken for hidden


def overlay(
    records: Sequence[Timed], longest: int, camera: WorldCamera, position: NDArray[np.float32], image: NDArray[np.float32]
) -> NDArray[np.float32]:
    """A dimmed grey image (H, W, 3) with a dot at every visible record of any cache: red lives one frame, green `longest` frames.

    position (H, W, 3): what pixels see; image: linear radiance.
    """
    height, width = image.shape[:2]
    grey = image @ LUMA
    top = float(np.percentile(grey, 99))
    picture = np.repeat(np.clip(grey / top if top > 0 else grey, 0, 1)[..., None] * DIMMED, 3, axis=2)
    place, life = (
        np.concatenate(column) for column in zip(*((timed.sites.position, timed.life) for timed in records), strict=True)
    )
    local = (place - camera.pose[:3, 3]) @ camera.pose[:3, :3]
    depth = np.maximum(-local[:, 2], 1e-9)
    scale = height / (2 * np.tan(camera.yfov / 2))
    column = np.floor(width / 2 + local[:, 0] / depth * scale).astype(np.int64)
    row = np.floor(height / 2 - local[:, 1] / depth * scale).astype(np.int64)
    inside = (local[:, 2] < 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    index = np.flatnonzero(inside)
    hidden = np.linalg.norm(position[row[index], column[index]] - place[index], axis=1) > NEAR * depth[index]
    index = index[~hidden]
    share = np.clip((life[index] - 1) / max(longest - 1, 1), 0, 1)
    picture[row[index], column[index]] = np.stack([np.minimum(2 - 2 * share, 1), np.minimum(2 * share, 1), 0 * share], 1)
    return picture.astype(np.float32)
