"""Shadow map cameras: one per light point, with an off-axis window that contains every ray of the pyramid.

A camera is one row of CAMERA float64 numbers in the pyramid's frame: rotation R (9, row by row: pyramid to camera), point s (3),
window u_0, Δu, v_0, Δv in the camera's tangents, rank in [0, 1): which half-transparent things it sees. Camera coordinates of P
are c = R (P - s), tangents c_x / c_z and c_y / c_z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.sampling import generator

F64 = NDArray[np.float64]
CAMERA = 17
S, U0, DU, V0, DV, RANK = 9, 12, 13, 14, 15, 16


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
    cameras[:, RANK] = ranks(len(s))
    return cameras


def ranks(count: int) -> F64:
    """(k + 1/2) / count in random order, always the same: any share of them is a share of all parts of the light."""
    return np.asarray((generator(0, "ranks").permutation(count) + 0.5) / count)
