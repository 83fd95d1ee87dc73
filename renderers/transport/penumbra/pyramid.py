"""The view pyramid of a penumbra deep shadow map: apex at the light's centre, a grid of rays uniform in tangents.

P in the pyramid's frame is `rotation @ (P_world - apex)`; depth Z is its third coordinate, tangents are u = X/Z and v = Y/Z. One
pyramid sees 90° at most here. A light that shines into a half space needs up to five, one that shines everywhere six: the faces of
a cube around it (the source has one; several are an extension). Each face is as wide as its share plus one pixel, so that bilinear
filtering never stops at a seam.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.transport.threads import chunks

F64 = NDArray[np.float64]
# vertices and triangles that are brought into another frame at a time
PIECE = 4096
# rows of the rotation in terms of the light's tangents and normal (x, y, z): front, four sides (their v grows along z), back
FACES = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
        [[0, -1, 0], [0, 0, 1], [-1, 0, 0]],
        [[-1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ],
    np.float64,
)


@dataclass(frozen=True, eq=False)
class Pyramid:
    """apex (3,), rotation (3, 3): world to pyramid. low (2,): tangents of the window's corner; pitch: tangent width of a pixel;
    width, height: pixels. near, far: covered depths, World units."""

    apex: F64
    rotation: F64
    low: tuple[float, float]
    pitch: float
    width: int
    height: int
    near: float
    far: float

    def local(self, points: ArrayLike) -> F64:
        """World points (..., 3) in the pyramid's frame, float64."""
        return np.asarray((np.asarray(points, np.float64) - self.apex) @ self.rotation.T)

    @cached_property
    def us(self) -> F64:
        """Tangents u of the pixel centres, (width,)."""
        return np.asarray(self.low[0] + (np.arange(self.width) + 0.5) * self.pitch)

    @cached_property
    def vs(self) -> F64:
        """Tangents v of the pixel centres, (height,)."""
        return np.asarray(self.low[1] + (np.arange(self.height) + 0.5) * self.pitch)

    @cached_property
    def corners(self) -> F64:
        """The eight corners of the covered frustum, (8, 3), pyramid's frame."""
        u = self.low[0] + np.array([0, self.width]) * self.pitch
        v = self.low[1] + np.array([0, self.height]) * self.pitch
        return np.array([[a * z, b * z, z] for z in (self.near, self.far) for a in u for b in v])


def pyramids_around(
    apex: F64, frame: F64, points: F64, geometry: NDArray[np.floating], resolution: int, near: float, *, one_sided: bool
) -> list[Pyramid]:
    """The pyramids that a light needs: those faces of its cube that hold geometry, each tight around it.

    frame (3, 3): rows are the light's tangents and normal. points (N, 3): light samples, geometry (V, 3): vertices of all
    receivers and casters; both in the World. resolution: pixels across 90°, or across the front face where that can be narrower.
    near: distance between the foremost light point and the near plane. one_sided: the light shines to the side of its normal only.
    """
    found = []
    for index, face in enumerate(FACES[:5] if one_sided else FACES):
        rotation = face @ frame
        foremost = max(float(((points - apex) @ rotation.T)[:, 2].max()), 0.0)
        seen = _seen(geometry, apex, rotation)
        low, high = _window(seen, half=one_sided and index > 0)
        far = seen.deepest * 1.001
        # all in front: no edge can come nearer than the nearest vertex
        start = max(foremost + near, seen.nearest * 0.999)
        if far <= start or (low >= high).any():
            continue
        pitch = float((high - low).max()) / resolution if index == 0 else 2.0 / resolution
        pixels = np.maximum(np.ceil((high - low) / pitch - 1e-9).astype(int), 1) + 2
        corner = (float(low[0]) - pitch, float(low[1]) - pitch)
        found.append(Pyramid(apex, rotation, corner, pitch, int(pixels[0]), int(pixels[1]), start, far))
    return found


class _Seen(NamedTuple):
    """Vertices in a pyramid's frame: least and greatest depth, bounds (2,) of their tangents where all are in front, and `reach`:
    the largest x + z, z - x, y + z, z - y and y.
    """

    nearest: float
    deepest: float
    low: F64
    high: F64
    reach: F64


def _seen(geometry: NDArray[np.floating], apex: F64, rotation: F64) -> _Seen:
    """The figures of all vertices (V, 3), in pieces."""
    nearest, deepest = np.inf, -np.inf
    low, high, reach = np.full(2, np.inf), np.full(2, -np.inf), np.full(5, -np.inf)
    for piece in chunks(len(geometry), PIECE):
        x, y, z = ((geometry[piece] - apex) @ rotation.T).T
        nearest, deepest = min(nearest, float(z.min())), max(deepest, float(z.max()))
        reach = np.maximum(reach, [(x + z).max(), (z - x).max(), (y + z).max(), (z - y).max(), y.max()])
        if nearest > 0:
            tangents = np.stack([x, y]) / z
            low, high = np.minimum(low, tangents.min(axis=1)), np.maximum(high, tangents.max(axis=1))
    return _Seen(nearest, deepest, low, high, reach)


def _window(seen: _Seen, *, half: bool) -> tuple[F64, F64]:
    """Tangent bounds (2,) and (2,) of the geometry inside a 90° face; `half`: only v ≥ 0. Empty (low ≥ high) if there is none."""
    low, high = np.array([-1.0, 0.0 if half else -1.0]), np.ones(2)
    if seen.nearest > 1e-3 * max(seen.deepest, 1e-9):
        return np.maximum(low, seen.low), np.minimum(high, seen.high)
    left, right, down, up, above = seen.reach
    outside = min(left, right, above if half else down, up) < 0 or seen.deepest <= 0
    return (low, low) if outside else (low, high)
