"""Triangles of simple shapes: positions float32 (V, 3), normals float32 (V, 3), triangles uint32 (T, 3), front outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Shape = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]


def disc(radius: float, segments: int = 64) -> Shape:
    """Disc in the XY plane facing -Z; the polygon's area is exactly π·radius²."""
    exact = radius * np.sqrt(np.pi / (segments / 2 * np.sin(2 * np.pi / segments)))
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * exact
    positions = np.vstack([[0, 0, 0], ring]).astype(np.float32)
    normals = np.tile(np.array([0, 0, -1], np.float32), (segments + 1, 1))
    rim = np.arange(segments)
    triangles = np.stack([np.zeros(segments), (rim + 1) % segments + 1, rim + 1], axis=1).astype(np.uint32)
    return positions, normals, triangles


def sphere(radius: float, segments: int = 48, rings: int = 24, *, exact_area: bool = True) -> Shape:
    """Latitude-longitude sphere, poles on Y, smooth normals; with `exact_area` its surface is scaled to 4π·radius²."""
    theta = np.pi * np.arange(rings + 1) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    body = np.stack(
        [
            np.outer(np.sin(theta[1:-1]), np.cos(phi)),
            np.outer(np.cos(theta[1:-1]), np.ones(segments)),
            -np.outer(np.sin(theta[1:-1]), np.sin(phi)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    unit = np.vstack([[0, 1, 0], body, [0, -1, 0]])
    here, there = np.arange(segments), (np.arange(segments) + 1) % segments
    parts = [np.stack([0 * here, 1 + here, 1 + there], axis=1)]
    for ring in range(rings - 2):
        a, b = 1 + ring * segments, 1 + (ring + 1) * segments
        parts += [np.stack([a + here, b + here, b + there], axis=1), np.stack([a + here, b + there, a + there], axis=1)]
    last, base = len(unit) - 1, 1 + (rings - 2) * segments
    parts.append(np.stack([base + here, 0 * here + last, base + there], axis=1))
    triangles = np.concatenate(parts).astype(np.uint32)
    scale = radius
    if exact_area:
        p = unit[triangles]
        area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2
        scale = radius * float(np.sqrt(4 * np.pi / area))
    return (unit * scale).astype(np.float32), unit.astype(np.float32), triangles
