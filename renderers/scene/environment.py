"""Radiance of the environment from a direction: constant, or a lat-long image.

Convention of lat-long images, that of Mitsuba's `envmap` emitter (measured, and tested with one bright texel): +Y is up, row 0 is
the +Y pole and the last row the -Y pole (rows lie *on* the poles: row j has θ = π·j/(H-1) from +Y); with d the direction in the
environment's frame, φ = atan2(d_x, -d_z), column i has its centre at φ = 2π·(i + ½)/W, and columns wrap around. Between texels the
look-up is bilinear. `Environment.rotation` turns the environment's frame into the world.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.model import Environment
from renderers.scene.transforms import rotation_matrix

F64 = NDArray[np.float64]


def radiance(environment: Environment, directions: F64) -> F64:
    """Radiance from unit `directions` (N, 3), float64 (N, 3). Raises ValueError for an image under 2×3 texels."""
    constant = np.array(environment.radiance, np.float64)
    if environment.image is None:
        return np.broadcast_to(constant, directions.shape).copy()
    image = checked_image(environment.image)
    height, width = image.shape[:2]
    d = directions @ rotation_matrix(environment.rotation)
    x = (np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi) * width - 0.5) % width
    y = np.arccos(np.clip(d[:, 1], -1, 1)) / np.pi * (height - 1)
    column, row = x.astype(np.int64) % width, np.minimum(y.astype(np.int64), height - 2)
    fx, fy = (x - np.floor(x))[:, None], (y - row)[:, None]
    following = (column + 1) % width
    upper = image[row, column] * (1 - fx) + image[row, following] * fx
    lower = image[row + 1, column] * (1 - fx) + image[row + 1, following] * fx
    return np.asarray((upper * (1 - fy) + lower * fy) * constant)


def checked_image(image: NDArray[np.float32]) -> F64:
    """The texels as float64 (H, W, 3). Raises ValueError where there are too few, or not three channels."""
    if image.ndim != 3 or image.shape[0] < 3 or image.shape[1] < 2 or image.shape[2] != 3:
        raise ValueError(f"a lat-long image needs at least 2x3 texels of RGB, got shape {image.shape}")
    return image.astype(np.float64)
