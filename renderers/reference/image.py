"""The Reference: a path-traced mean with its variance, continued replicate by replicate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from renderers.images import luminance
from renderers.method import Transport

PixelMode = Literal["centre", "box"]


@dataclass(frozen=True, eq=False)
class Reference:
    """Sums over `n` independent replicates of `spp` samples per pixel each; from them mean, variance of the mean, noise.

    total, squares float64 (H, W, 3): sum and sum of squares per channel; squares_y float64 (H, W): of luminance.
    surface bool (H, W): first hit is a surface that doesn't emit (emitters and background are left out of `noise`).
    alternating float64 (H, W, 3): the even replicates minus the odd ones; None where sums without it were continued.
    """

    total: NDArray[np.float64]
    squares: NDArray[np.float64]
    squares_y: NDArray[np.float64]
    surface: NDArray[np.bool_]
    n: int
    spp: int
    scene_hash: str
    transport: Transport
    pixel: PixelMode
    frame: int
    notes: tuple[str, ...] = ()
    alternating: NDArray[np.float64] | None = None

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """Mean radiance, float32 (H, W, 3)."""
        return (self.total / self.n).astype(np.float32)

    @cached_property
    def variance(self) -> NDArray[np.float32]:
        """Variance of the mean per channel, float32 (H, W, 3)."""
        spread = self.squares - self.total**2 / self.n
        return (np.maximum(spread, 0) / (self.n - 1) / self.n).astype(np.float32)

    @cached_property
    def luminance_variance(self) -> NDArray[np.float32]:
        """Variance of the mean luminance, float32 (H, W)."""
        spread = self.squares_y - luminance(self.total) ** 2 / self.n
        return (np.maximum(spread, 0) / (self.n - 1) / self.n).astype(np.float32)

    @cached_property
    def noise_sample(self) -> NDArray[np.float32] | None:
        """An image of what the mean may be off by: zero mean, and the variance of the mean, float32 (H, W, 3).

        Σ (sᵢ − s̄) xᵢ / n over replicates x with signs s = +1, −1, +1, …: the same sum as the error of the mean, with signs. All
        frames take replicate i from the same random numbers, so what is common to the errors of two frames is common to their
        samples too. None where the alternating sum isn't known.
        """
        if self.alternating is None:
            return None
        return ((self.alternating - self.n % 2 * self.total / self.n) / self.n).astype(np.float32)

    @cached_property
    def noise(self) -> float:
        """sqrt(mean variance of the mean luminance) / mean luminance over `surface` pixels; 0 for an image of zero mean."""
        if not self.surface.any():
            return 0.0
        mean = float(luminance(self.image)[self.surface].mean())
        return float(np.sqrt(self.luminance_variance[self.surface].mean(dtype=np.float64)) / mean) if mean > 0 else 0.0

    def interval(self, level: float = 0.95) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Confidence interval (low, high) of each pixel's mean luminance, float64 (H, W): Student's t, n - 1 degrees of freedom.

        level lies in (0, 1). Raises ValueError otherwise.
        """
        if not 0 < level < 1:
            raise ValueError(f"level must lie in (0, 1), got {level}")
        from scipy.stats import t

        mean = luminance(self.total) / self.n
        half = float(t.ppf((1 + level) / 2, self.n - 1)) * np.sqrt(self.luminance_variance.astype(np.float64))
        return mean - half, mean + half


def exposure(reference: Reference) -> float:
    """1 / 99th percentile of luminance over the pixels of `surface` (no emitter, no background); 1 for a black image.

    Taken of the first `full` reference at frame 0 and then used for every image of the scene.
    """
    values = luminance(reference.image)[reference.surface]
    white = float(np.percentile(values, 99)) if values.size else 0.0
    return 1.0 / white if white > 0 else 1.0
