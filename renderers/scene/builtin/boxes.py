"""Animated boxes for temporal methods: a moving cube, a moving light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.rooms import open_room
from renderers.scene.builtin.solids import box, quads_shape
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.shapes import sphere

F64 = NDArray[np.float64]
FPS = 24.0


@checked(period=(2, 100_000))
def cube_in_a_box(period: int = 400) -> Scene:
    """Cube that moves on an ellipse and turns in a closed box with a point light: 24 triangles, `period` frames a round."""
    b = SceneBuilder("cube-in-a-box")
    white, red, green, blue = _paints(b)
    open_room(b, (-1, 0, -1), (1, 2, 1), white=white, left=red, right=green, front=white)
    cube = b.place(box((-0.25, -0.25, -0.25), (0.25, 0.25, 0.25)), blue, "cube")
    turn = 2 * np.pi * np.arange(period + 1) / period
    path = np.column_stack([0.5 * np.cos(turn), 0.65 + 0.15 * np.sin(2 * turn), -0.3 + 0.4 * np.sin(turn)])
    b.animate(cube, "translation", np.arange(period + 1) / FPS, path)
    b.animate(cube, "rotation", np.arange(period + 1) / FPS, yaw(turn))
    b.light(PointLight("lamp", (1.0, 0.93, 0.8), 4.0), (0.0, 1.8, 0.1))
    b.camera((0.0, 1.05, 0.97), (0.0, 0.85, -0.5), np.radians(70))
    return b.build(fps=FPS, period=period)


@checked(period=(2, 100_000))
def moving_light(period: int = 100) -> Scene:
    """Static room with an 8×8 chequered floor, a block and a ball; the point light runs on a circle, `period` frames a round."""
    b = SceneBuilder("moving-light")
    white, red, green, blue = _paints(b)
    open_room(b, (-1, 0, -1), (1, 2, 1), white=white, left=red, right=green, floor=-1)
    light_tile, dark_tile = b.material(Lambert("light tile", (0.8,) * 3)), b.material(Lambert("dark tile", (0.2,) * 3))
    for parity, paint in ((0, light_tile), (1, dark_tile)):
        cells = [(i, k) for i in range(8) for k in range(8) if (i + k) % 2 == parity]
        ring = [[(i, k), (i, k + 1), (i + 1, k + 1), (i + 1, k)] for i, k in cells]
        corners = np.array([[(-1 + x / 4, 0.0, -1 + z / 4) for x, z in tile] for tile in ring])
        b.place(quads_shape(corners), paint, "tiles")
    b.place(box((-0.6, 0, -0.65), (-0.1, 0.9, -0.2)), white, "block")
    b.place(sphere(0.3, 32, 16), blue, "ball", translation=(0.4, 0.3, 0.1))
    turn = 2 * np.pi * np.arange(period + 1) / period
    lamp = b.light(PointLight("lamp", (1.0, 0.93, 0.8), 3.0), (0.6, 1.65, 0.0))
    path = np.column_stack([0.6 * np.cos(turn), np.full_like(turn, 1.65), 0.6 * np.sin(turn)])
    b.animate(lamp, "translation", np.arange(period + 1) / FPS, path)
    b.camera((0.0, 1.0, 3.6), (0.0, 0.95, 0.0), np.radians(42))
    return b.build(fps=FPS, period=period)


def yaw(angle: F64) -> F64:
    """Quaternions (K, 4) of turns about +Y by angles (K,) in radians."""
    zero = np.zeros_like(angle)
    return np.column_stack([zero, np.sin(angle / 2), zero, np.cos(angle / 2)])


def _paints(b: SceneBuilder) -> tuple[int, int, int, int]:
    colors = (("white", (0.75, 0.75, 0.75)), ("red", (0.65, 0.1, 0.08)), ("green", (0.12, 0.5, 0.12)), ("blue", (0.2, 0.35, 0.7)))
    white, red, green, blue = (b.material(Lambert(name, color)) for name, color in colors)
    return white, red, green, blue
