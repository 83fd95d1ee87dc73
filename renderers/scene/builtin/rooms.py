"""Box rooms that several scenes share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from renderers.scene.builder import SceneBuilder


def open_room(
    b: SceneBuilder, low: ArrayLike, high: ArrayLike, *, white: int, left: int, right: int,
    back: int | None = None, floor: int | None = None, front: int | None = None,
) -> None:  # fmt: skip
    """Box room low..high facing inwards, one quad a wall; `front` (towards +Z) stays open unless it has a material.

    floor, ceiling, back are `white` unless given; left is -X, right is +X. floor -1 leaves the floor out.
    """
    (x0, y0, z0), (x1, y1, z1) = _triple(low), _triple(high)
    if floor != -1:
        b.quad([(x0, y0, z0), (x0, y0, z1), (x1, y0, z1), (x1, y0, z0)], white if floor is None else floor, "floor")
    b.quad([(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)], white, "ceiling")
    b.quad([(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)], white if back is None else back, "back")
    b.quad([(x0, y0, z1), (x0, y0, z0), (x0, y1, z0), (x0, y1, z1)], left, "left")
    b.quad([(x1, y0, z0), (x1, y0, z1), (x1, y1, z1), (x1, y1, z0)], right, "right")
    if front is not None:
        b.quad([(x1, y0, z1), (x0, y0, z1), (x0, y1, z1), (x1, y1, z1)], front, "front")


def _triple(point: ArrayLike) -> tuple[float, float, float]:
    x, y, z = np.asarray(point, float)
    return float(x), float(y), float(z)
