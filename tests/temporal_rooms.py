"""Animated rooms that temporal caching is checked in. Metres, z up, 24 frames per second."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from caching_rooms import ALBEDOS_2, EYE_2, FORWARD_2, FOV_2, INTENSITY_2, LIGHT_2, shell, sites
from numpy.typing import ArrayLike, NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box
from renderers.scene.model import Channel, DirectionalLight, DiscLight, Environment, Lambert, PointLight, Scene, SpotLight
from renderers.scene.shapes import sphere
from renderers.scene.world import World
from renderers.transport.caching.records import Sites

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


def line(start: ArrayLike, step: ArrayLike) -> Path:
    """From a point on by as much in every frame."""
    return lambda t: np.asarray(start, np.float64) + np.outer(t, step)


def slow_cube(frames: int = 60) -> Scene:
    """A cube that slides along by 1 cm a frame."""
    return room(cube=line((-0.6, 0.4, 0.45), (0.01, 0, 0)), frames=frames)


def floor(world: World, xy: ArrayLike) -> Sites:
    """Places (N, 2) in metres on a floor at z = 0."""
    found = np.asarray(xy, np.float64)
    return sites(world, np.column_stack([found, np.zeros(len(found))]), np.tile([0.0, 0, 1], (len(found), 1)))


def floor_and_wall(world: World, random: np.random.Generator, count: int) -> Sites:
    """So many places of `toy_box`, on its floor or its wall x = -1 by chance."""
    xy, wall = random.uniform(-0.95, 0.95, (count, 2)), random.random(count)[:, None] < 0.5
    on_wall, on_floor = np.column_stack([-np.ones(count), xy[:, 0], xy[:, 1] + 1]), np.column_stack([xy, np.zeros(count)])
    return sites(world, np.where(wall, on_wall, on_floor), np.where(wall, [[1.0, 0, 0]], [[0, 0, 1.0]]))


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


def yard(light: str, cubes: int, wall: float = 0.7) -> Scene:
    """A floor of 4 × 4 and a wall, under one light; one broad block above it, or rows of narrow ones, that slide by
    6 cm in a frame."""
    b = SceneBuilder("yard")
    b.quad([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], b.material(Lambert("floor", (0.5,) * 3)), "floor")
    b.quad([(-2, 2, 0), (2, 2, 0), (2, 2, 2), (-2, 2, 2)], b.material(Lambert("wall", (wall,) * 3)), "wall")
    grey = b.material(Lambert("cube", (0.6,) * 3))
    half = 0.3 if cubes == 1 else 0.03
    for x in np.linspace(-1.5, 1.3, cubes) if cubes > 1 else [0.0]:
        node = b.place(box((-half, 0.5, 0.3), (half, 0.9, 0.9)), grey, "cube")
        b.animate(node, "translation", np.arange(2) / FPS, [(x, 0, 0), (x + 0.06, 0, 0)])
    slanted = (np.sin(0.2), 0.0, 0.0, np.cos(0.2))
    match light:
        case "point":
            b.light(PointLight("lamp", (1.0,) * 3, 9.0), (0.0, -0.5, 2.0))
        case "spot":
            b.light(SpotLight("lamp", (1.0,) * 3, 9.0, 0.3, 0.9), (0.0, -0.5, 2.5), slanted)
        case "directional":
            b.light(DirectionalLight("sun", (1.0,) * 3, 3.0), rotation=slanted)
        case "area":
            b.light(DiscLight("panel", (1.0,) * 3, 9.0, 0.4), (0.0, -0.5, 2.5))
        case "sky":
            b.environment = Environment((0.8, 0.9, 1.0))
    b.camera((0, -2, 1), (0, 0, 1), 1.0, (0, 0, 1))
    return b.build(fps=FPS)
