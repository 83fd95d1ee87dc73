"""Animated rooms that temporal caching is checked in. Metres, z up, 24 frames per second."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from caching_rooms import ALBEDOS_2, EYE_2, FORWARD_2, FOV_2, INTENSITY_2, LIGHT_2, shell
from numpy.typing import ArrayLike, NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box
from renderers.scene.model import Channel, Lambert, PointLight, Scene
from renderers.scene.shapes import sphere

F64 = NDArray[np.float64]
FPS = 24.0
Path = Callable[[F64], ArrayLike]  # frames (N,) to positions (N, 3)


def room(
    cube: Path | None = None,
    lamp: Path | None = None,
    intensity: Callable[[F64], ArrayLike] | None = None,
    camera: Path | None = None,
    frames: int = 60,
) -> Scene:
    """Room 2's shell with a cube of edge 0.8 and a lamp, each moved, or the lamp's intensity changed, by functions of the frame."""
    b = SceneBuilder("moving-room")
    shell(b, ALBEDOS_2)
    grey = b.material(Lambert("box", (ALBEDOS_2["box"],) * 3))
    node = b.place(box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)), grey, "cube", translation=(0.3, 0.4, 0.45))
    light = b.light(PointLight("lamp", (1.0, 1.0, 1.0), INTENSITY_2), LIGHT_2)
    eye = b.camera(EYE_2, EYE_2 + FORWARD_2, FOV_2, (0, 0, 1))
    t = np.arange(frames + 1.0)
    for target, path in ((node, cube), (light, lamp), (eye, camera)):
        if path is not None:
            b.animate(target, "translation", t / FPS, path(t))
    if intensity is not None:
        values = np.asarray(intensity(t), np.float64)[:, None]
        b.channels.append(Channel("light", 0, "intensity", t / FPS, values))
    return b.build(fps=FPS, frames=frames)


def toy_box(speed: float = 1.0, light_speed: float = 1.0, frames: int = 120) -> Scene:
    """The specification's box for reprojection: sphere, turning cube and point light, all moving."""
    b = SceneBuilder("reprojection-box")
    quads = {
        "floor": (0.75, [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]),
        "ceiling": (0.75, [(-1, -1, 2), (-1, 1, 2), (1, 1, 2), (1, -1, 2)]),
        "-x": (0.75, [(-1, -1, 0), (-1, 1, 0), (-1, 1, 2), (-1, -1, 2)]),
        "+x": (0.25, [(1, -1, 0), (1, -1, 2), (1, 1, 2), (1, 1, 0)]),
        "-y": (0.35, [(-1, -1, 0), (-1, -1, 2), (1, -1, 2), (1, -1, 0)]),
        "+y": (0.6, [(-1, 1, 0), (1, 1, 0), (1, 1, 2), (-1, 1, 2)]),
    }
    for name, (albedo, corners) in quads.items():
        b.quad(np.array(corners, np.float64), b.material(Lambert(name, (albedo,) * 3)), name)
    ball = b.place(sphere(0.3, 48, 24), b.material(Lambert("ball", (0.75,) * 3)), "ball")
    cube = b.place(box((-0.25, -0.25, -0.25), (0.25, 0.25, 0.25)), b.material(Lambert("cube", (0.5,) * 3)), "cube")
    lamp = b.light(PointLight("lamp", (1.0, 1.0, 1.0), 6.0), (0.3, 0.0, 1.8))
    b.camera((0, -0.95, 1.0), (0, 0, 1.0), np.radians(75), (0, 0, 1))
    t = np.arange(frames + 1.0)
    v, w = speed * t, light_speed * t
    b.animate(
        ball,
        "translation",
        t / FPS,
        np.stack([0.55 * np.cos(0.06 * v), 0.55 * np.sin(0.06 * v), 0.45 + 0.15 * np.sin(0.11 * v)], 1),
    )
    b.animate(cube, "translation", t / FPS, np.stack([-0.35 * np.sin(0.05 * v), 0.3 * np.cos(0.05 * v), 1.25 + 0 * v], 1))
    turn = np.stack([0 * v, 0 * v, np.sin(0.02 * v), np.cos(0.02 * v)], 1)
    b.animate(cube, "rotation", t / FPS, turn)
    b.animate(lamp, "translation", t / FPS, np.stack([0.3 * np.cos(0.03 * w), 0.3 * np.sin(0.03 * w), 1.8 + 0 * w], 1))
    return b.build(fps=FPS, frames=frames)
