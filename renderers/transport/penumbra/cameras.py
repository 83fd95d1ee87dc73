"""Shadow map cameras: one per light point, with an off-axis window that contains every ray of the pyramid.

A camera is one row of CAMERA float64 numbers in the pyramid's frame: rotation R (9, row by row: pyramid to camera), point s (3),
window u_0, Δu, v_0, Δv in the camera's tangents. Camera coordinates of P are c = R (P - s), tangents c_x / c_z and c_y / c_z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.transport.penumbra.pyramid import Pyramid

F64 = NDArray[np.float64]
CAMERA = 16
S, U0, DU, V0, DV = 9, 12, 13, 14, 15


def cameras_of(pyramid: Pyramid, points: ArrayLike, resolution: int, rotations: ArrayLike | None = None) -> F64:
    """Cameras (N, CAMERA) at `points` (N, 3, pyramid's frame) with maps of resolution².

    rotations (N, 3, 3), pyramid to camera: the general case; without them all cameras are parallel to the pyramid (St-Amour 2004
    §3.1). Windows hold the pyramid between its near and far plane and one texel more on each side. Raises ValueError where a camera
    sees a corner of it at its own plane or behind.
    """
    s = np.asarray(points, np.float64).reshape(-1, 3)
    turn = np.broadcast_to(np.eye(3), (len(s), 3, 3)) if rotations is None else np.asarray(rotations, np.float64)
    seen = np.einsum("nij,nkj->nki", turn, pyramid.corners[None] - s[:, None])
    if not (seen[..., 2] > 0).all():
        raise ValueError("the pyramid reaches behind a shadow map camera: move its near plane away from the light")
    tangents = seen[..., :2] / seen[..., 2:]
    low, high = tangents.min(axis=1), tangents.max(axis=1)
    pitch = (high - low) / (resolution - 2)
    cameras = np.empty((len(s), CAMERA))
    cameras[:, :9] = turn.reshape(-1, 9)
    cameras[:, S : S + 3] = s
    cameras[:, [U0, V0]] = low - pitch
    cameras[:, [DU, DV]] = pitch
    return cameras
