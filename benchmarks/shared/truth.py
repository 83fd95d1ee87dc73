"""Frames, and the error of their indirect light against path tracing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import renderers
from renderers.frame import Frame

Image = NDArray[np.float64]
Where = NDArray[np.bool_] | slice
EVERYWHERE = slice(None)
SEED, DIRECT_PATHS, HALF, HALF_SEEDS = 1, 256, 1024, (101, 102)


def rendered(scene: renderers.Scene, kind: str, size: tuple[int, int], seed: int = SEED, **values: Any) -> Frame:
    """One frame of a method with these settings."""
    method = renderers.get_method(kind)
    return method.render(scene, method.Settings(**values), size=size, seed=seed)


class Truth(NamedTuple):
    """Direct light, indirect light and the variance of its noise, (H, W, 3)."""

    direct: Image
    indirect: Image
    variance: Image

    @staticmethod
    def of(scene: renderers.Scene, size: tuple[int, int], transport: str = "full") -> Truth:
        """By path tracing, in two independent halves, whose noise is known from their difference."""
        direct = rendered(scene, "pt", size, transport="direct", spp=DIRECT_PATHS).layers["beauty"].astype(np.float64)
        halves = [
            rendered(scene, "pt", size, seed=seed, transport=transport, spp=HALF).layers["beauty"] - direct for seed in HALF_SEEDS
        ]
        mean, apart = (halves[0] + halves[1]) / 2, halves[0] - halves[1]
        return Truth(direct, mean, apart**2 / 4)

    def indirect_of(self, frame: Frame) -> NDArray[np.floating]:
        """Indirect light of a frame: `pt` has no such layer, so its direct light, drawn exactly, is subtracted."""
        return frame.layers["indirect"] if "indirect" in frame.layers else frame.layers["beauty"] - self.direct

    def error(self, found: Frame | NDArray[np.floating], where: Where = EVERYWHERE, over: Where = EVERYWHERE) -> float:
        """RMSE of a frame, or of indirect light (H, W, 3), in the pixels `where`, less the truth's own noise, over the mean of the
        pixels `over`; linear radiance."""
        indirect = self.indirect_of(found) if isinstance(found, Frame) else found
        square = float(np.mean(((indirect - self.indirect) ** 2 - self.variance)[where]))
        return float(np.sqrt(max(square, 0.0)) / self.indirect[over].mean())
