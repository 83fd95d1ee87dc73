"""What the camera sees, one sample a pixel.

Filled by GL (`renderers.gl.gbuffer`) or by ray casting (`renderers.transport.primary`), with the same arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class GBuffer:
    """First hits in World (normalised) coordinates; background pixels have triangle -1 and zeros elsewhere.

    position float32 (H, W, 3). normal float32 (H, W, 3): unit interpolated shading normal, turned to the viewer (n·v ≥ 0).
    base float32 (H, W, 3): base colour × texture, linear. emission float32 (H, W, 3): radiance emitted towards the viewer.
    triangle int32 (H, W): row of World.triangles. material int32 (H, W): row of World.materials (-1 on the background).
    eye float64 (3,): camera position. offset: position of the sample in the pixel, (0.5, 0.5) = centre.
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    base: NDArray[np.float32]
    emission: NDArray[np.float32]
    triangle: NDArray[np.int32]
    material: NDArray[np.int32]
    eye: NDArray[np.float64]
    offset: tuple[float, float] = (0.5, 0.5)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Pixels that see a surface, bool (H, W)."""
        return self.triangle >= 0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)."""
        return self.triangle.shape[1], self.triangle.shape[0]
