"""Triangle shapes that the built-in scenes are made of. A Shape is (positions, normals, triangles), counter-clockwise outside.

Everything is made from `grid`: a sheet of points in rows and columns whose front is the side of (next row) × (next column).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.shapes import Shape

F64 = NDArray[np.float64]


def grid(points: ArrayLike) -> Shape:
    """Smooth sheet through points (R, C, 3), R and C ≥ 2; normals by central differences. Equal end columns make no crease."""
    p = np.asarray(points, np.float64)
    down, right = _difference(p, 0), _difference(p, 1)
    normals = np.cross(down, right)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rows, columns = p.shape[:2]
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    below = corner + columns
    triangles = np.concatenate([np.stack([corner, below, below + 1], 1), np.stack([corner, below + 1, corner + 1], 1)])
    return p.reshape(-1, 3).astype(np.float32), normals.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)


def _difference(p: F64, axis: int) -> F64:
    first, last = np.take(p, [0], axis), np.take(p, [-1], axis)
    if p.shape[axis] > 3 and np.allclose(first, last, atol=1e-9):
        before = np.concatenate([np.take(p, [-2], axis), p], axis)
        after = np.concatenate([p, np.take(p, [1], axis)], axis)
        return np.asarray(np.diff(before, axis=axis) + np.diff(after, axis=axis))
    step = np.diff(p, axis=axis)
    ends = np.concatenate([np.take(step, [0], axis), step], axis), np.concatenate([step, np.take(step, [-1], axis)], axis)
    return np.asarray(ends[0] + ends[1])


def patch(corners: ArrayLike, rows: int = 1, columns: int = 1) -> Shape:
    """Planar quad of corners (4, 3), counter-clockwise in front, cut into rows × columns cells (rows run along corner 0 to 1)."""
    a, b, c, d = np.asarray(corners, np.float64)
    u, v = np.linspace(0, 1, rows + 1)[:, None, None], np.linspace(0, 1, columns + 1)[None, :, None]
    return grid((1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d)


def box(low: ArrayLike, high: ArrayLike, cell: float = np.inf) -> Shape:
    """Axis-aligned box, faces cut into cells of about `cell`; counter-clockwise outside."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    faces = []
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for side in (low, high):
            ring = np.tile(low, (4, 1))
            ring[:, axis] = side[axis]
            ring[1:3, a], ring[2:4, b] = high[a], high[b]
            if side is low:
                ring = ring[[0, 3, 2, 1]]
            cut = [max(1, round(float(np.linalg.norm(ring[k] - ring[0])) / cell)) for k in (1, 3)]
            faces.append(patch(ring, *cut))
    return merge(*faces)


def lathe(profile: ArrayLike, segments: int, axis: str = "y") -> Shape:
    """Surface of revolution of profile points (P, 2) = (radius > 0, height); a profile that goes up faces outwards."""
    r, h = np.asarray(profile, np.float64).T
    angle = 2 * np.pi * np.arange(segments + 1) / segments
    angle[-1] = 0.0
    turned = np.stack([np.outer(r, np.sin(angle)), np.outer(h, np.ones_like(angle)), np.outer(r, np.cos(angle))], axis=-1)
    shape = flipped(grid(turned))
    return shape if axis == "y" else swapped(shape, axis)


def swapped(shape: Shape, axis: str) -> Shape:
    """A shape along Y turned to lie along `axis` (x or z) by a cyclic exchange of coordinates."""
    shift = {"x": -1, "z": 1, "y": 0}[axis]
    return np.roll(shape[0], shift, axis=1), np.roll(shape[1], shift, axis=1), shape[2]


def tube(path: ArrayLike, radii: ArrayLike, segments: int) -> Shape:
    """Tube around a path (P, 3), radii (P,) > 0, open at both ends; frames are carried along the path without twist."""
    p = np.asarray(path, np.float64)
    along = _difference(p, 0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], [1.0, 0.0, 0.0] if abs(along[0, 0]) < 0.8 else [0.0, 0.0, 1.0])
    angle = 2 * np.pi * np.arange(segments + 1) / segments
    angle[-1] = 0.0
    rings = []
    for point, direction, radius in zip(p, along, np.broadcast_to(np.asarray(radii, np.float64), len(p)), strict=True):
        side = side - direction * (side @ direction)
        side /= np.linalg.norm(side)
        other = np.cross(direction, side)
        rings.append(point + radius * (np.outer(np.cos(angle), side) + np.outer(np.sin(angle), other)))
    return flipped(grid(np.array(rings)))


def loft(rings: ArrayLike) -> Shape:
    """Flat quads between consecutive closed rings (R, P, 3), counter-clockwise about +Z: rising ones face outwards."""
    p = np.asarray(rings, np.float64)
    after = np.roll(p, -1, axis=1)
    quads = np.stack([p[:-1], after[:-1], after[1:], p[1:]], axis=2)
    return quads_shape(quads.reshape(-1, 4, 3))


def quads_shape(quads: ArrayLike) -> Shape:
    """Separate flat quads (Q, 4, 3), counter-clockwise in front, sharing no vertices."""
    q = np.asarray(quads, np.float64)
    normals = np.cross(q[:, 2] - q[:, 0], q[:, 3] - q[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    first = 4 * np.arange(len(q))
    triangles = np.concatenate([np.stack([first, first + 1, first + 2], 1), np.stack([first, first + 2, first + 3], 1)])
    return q.reshape(-1, 3).astype(np.float32), np.repeat(normals, 4, axis=0).astype(np.float32), triangles.astype(np.uint32)


def flipped(shape: Shape) -> Shape:
    """The same surface with its front on the other side."""
    positions, normals, triangles = shape
    return positions, -normals, triangles[:, ::-1].copy()


def moved(shape: Shape, offset: ArrayLike, rotation: F64 | None = None) -> Shape:
    """Rotated by a proper rotation (3, 3), then translated."""
    positions, normals, triangles = shape
    turn = np.eye(3) if rotation is None else rotation
    return (positions @ turn.T + np.asarray(offset)).astype(np.float32), (normals @ turn.T).astype(np.float32), triangles


def merge(*shapes: Shape) -> Shape:
    """One shape of many."""
    starts = np.cumsum([0] + [len(s[0]) for s in shapes[:-1]])
    return (
        np.concatenate([s[0] for s in shapes]),
        np.concatenate([s[1] for s in shapes]),
        np.concatenate([s[2] + np.uint32(k) for s, k in zip(shapes, starts, strict=True)]).astype(np.uint32),
    )


def area(shape: Shape) -> float:
    """Surface area of a shape."""
    p = shape[0][shape[2]].astype(np.float64)
    return float(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2)
