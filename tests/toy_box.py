"""A closed box around a ball under one point light, white enough for its bounce to matter: 17,408 triangles."""

from __future__ import annotations

from functools import cache

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.shapes import sphere

RADIUS = 3**0.5
SURFACE = 24 + 4 * np.pi * 0.4**2


@cache
def toy_box(cells: int = 32) -> Scene:
    """[-1, 1]³ seen from inside, walls of cells² squares, a ball of radius 0.4, a light of 1 W/sr, albedo 0.7 throughout."""
    b = SceneBuilder("toy box")
    paint = b.material(Lambert(albedo=(0.7, 0.7, 0.7)))
    b.place(sphere(0.4, 64, 41), paint, translation=(0.15, -0.3, -0.2))
    for axis in range(3):
        for side in (-1.0, 1.0):
            b.place(_wall(axis, side, cells), paint)
    b.light(PointLight("lamp", intensity=1.0), (-0.3, 0.7, 0.3))
    b.camera((0.0, 0.1, 0.95), (0.0, -0.1, 0.0), np.radians(70))
    return b.build()


def _wall(axis: int, side: float, cells: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inner face of the box's wall that is square to an axis."""
    s, t = np.meshgrid(np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, cells + 1), indexing="ij")
    p = np.empty((s.size, 3), np.float32)
    p[:, axis], p[:, (axis + 1) % 3], p[:, (axis + 2) % 3] = side, s.ravel(), t.ravel()
    n = np.zeros_like(p)
    n[:, axis] = -side
    a = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return p, n, (faces[:, ::-1] if side > 0 else faces).astype(np.uint32)
