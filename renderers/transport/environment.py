"""Light from everywhere: constant or lat-long radiance, its look-up and importance sampling.

Convention of lat-long images, that of Mitsuba's `envmap` emitter (measured, and tested with one bright texel): +Y is up, row 0 is
the +Y pole and the last row the -Y pole (rows lie *on* the poles: row j has θ = π·j/(H-1) from +Y); with d the direction in the
environment's frame, φ = atan2(d_x, -d_z), column i has its centre at φ = 2π·(i + ½)/W, and columns wrap around. Between texels the
look-up is bilinear. `Environment.rotation` turns the environment's frame into the world.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA
from renderers.scene.model import Environment
from renderers.scene.world import rotation_matrix
from renderers.transport.sampling import pick

F64 = NDArray[np.float64]


def radiance(environment: Environment, directions: F64) -> F64:
    """Radiance from unit `directions` (N, 3), float64 (N, 3). Raises ValueError for an image under 2×3 texels."""
    constant = np.array(environment.radiance, np.float64)
    if environment.image is None:
        return np.broadcast_to(constant, directions.shape).copy()
    image = _checked(environment.image)
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


class EnvironmentSampler:
    """Draws directions of a lat-long environment ∝ its luminance: one cell between four texels each, uniform in solid angle within.

    Each cell's weight is the mean luminance of its corners × its solid angle, hence positive wherever the bilinear look-up is.
    """

    def __init__(self, environment: Environment) -> None:
        if environment.image is None:
            raise ValueError("a constant environment has no image to sample")
        self._environment = environment
        self._image = _checked(environment.image)
        self._rotation = rotation_matrix(environment.rotation)

    @cached_property
    def _weights(self) -> F64:
        """Probability of each cell, float64 (H-1, W)."""
        luminance = self._image @ LUMA
        following = np.roll(luminance, -1, axis=1)
        mean = (luminance[:-1] + luminance[1:] + following[:-1] + following[1:]) / 4
        weights = mean * self._heights[:, None]
        return np.asarray(weights / weights.sum())

    @cached_property
    def _heights(self) -> F64:
        """cos θ at the upper minus at the lower edge of each row of cells, float64 (H-1,)."""
        return np.asarray(-np.diff(np.cos(np.pi * np.arange(len(self._image)) / (len(self._image) - 1))))

    @property
    def black(self) -> bool:
        """Whether the image carries no light at all."""
        return not self._image.any()

    def sample(self, random: F64) -> tuple[F64, F64]:
        """Unit world directions (N, 3) and their density per steradian (N,); random (N, 3) in [0, 1): cell, and place in it."""
        rows, width = self._weights.shape
        cell = pick(self._weights.ravel(), random[:, 0])
        row, column = cell // width, cell % width
        cos = np.cos(np.pi * row / rows) - random[:, 1] * self._heights[row]
        phi = 2 * np.pi * (column + 0.5 + random[:, 2]) / width
        sin = np.sqrt(np.maximum(0, 1 - cos * cos))
        local = np.stack([sin * np.sin(phi), cos, -sin * np.cos(phi)], axis=1)
        density = self._weights.ravel()[cell] / (self._heights[row] * 2 * np.pi / width)
        return local @ self._rotation.T, np.asarray(density)


def _checked(image: NDArray[np.float32]) -> F64:
    if image.ndim != 3 or image.shape[0] < 3 or image.shape[1] < 2 or image.shape[2] != 3:
        raise ValueError(f"a lat-long image needs at least 2x3 texels of RGB, got shape {image.shape}")
    return image.astype(np.float64)
