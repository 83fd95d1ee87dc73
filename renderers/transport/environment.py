"""Importance sampling of a lat-long environment (its look-up and orientation: `renderers.scene.environment`)."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA
from renderers.scene.environment import checked_image
from renderers.scene.model import Environment
from renderers.scene.world import rotation_matrix
from renderers.transport.sampling import pick

F64 = NDArray[np.float64]


class EnvironmentSampler:
    """Draws directions of a lat-long environment ∝ its luminance: one cell between four texels each, uniform in solid angle within.

    Each cell's weight is the mean luminance of its corners × its solid angle, hence positive wherever the bilinear look-up is.
    """

    def __init__(self, environment: Environment) -> None:
        if environment.image is None:
            raise ValueError("a constant environment has no image to sample")
        self._environment = environment
        self._image = checked_image(environment.image)
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
