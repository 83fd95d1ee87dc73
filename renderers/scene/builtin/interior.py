"""A furnished room of many triangles: a lamp is carried through it, then rests while two things on the floor go on moving."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.boxes import FPS, yaw
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.rooms import open_room
from renderers.scene.builtin.solids import box, lathe, merge, moved, tube
from renderers.scene.model import Lambert, Phong, PointLight, Scene
from renderers.scene.shapes import Shape, sphere

F64 = NDArray[np.float64]
TABLE_TOP, SEAT = 0.75, 0.45
VASE_RADII = (0.06, 0.10, 0.12, 0.11, 0.08, 0.05, 0.04, 0.05, 0.065)
CHAIRS = ((-0.55, 0.75, np.pi), (0.55, 0.75, np.pi), (-0.55, -0.75, 0.0), (0.55, -0.75, 0.0), (-1.35, 0.0, np.pi / 2))


@checked(frames=(6, 100_000))
def interior(frames: int = 750) -> Scene:
    """Furnished room of about 110,000 triangles: the lamp moves for a third of the `frames`, a ball and a top for all of them.

    All diffuse but the glossy vases. The ball rolls to and fro before the table, the top spins on a circle beside it.
    """
    b = SceneBuilder("interior")
    white, wood = b.material(Lambert("plaster", (0.75, 0.73, 0.68))), b.material(Lambert("wood", (0.45, 0.28, 0.15)))
    left, right = b.material(Lambert("left", (0.55, 0.3, 0.2))), b.material(Lambert("right", (0.3, 0.42, 0.5)))
    floor = b.material(Lambert("floor", (0.5, 0.42, 0.33)))
    open_room(b, (-3, 0, -2), (3, 2.8, 2), white=white, left=left, right=right, floor=floor, front=white)
    _furniture(b, wood)
    _crockery(b)
    _props(b, frames)
    lamp = b.light(PointLight("lamp", (1.0, 0.9, 0.75), 11.0), (-1.6, 2.2, 0.9))
    time = np.arange(frames + 1)
    turn = np.pi * np.minimum(time / (frames // 3), 1)
    b.animate(lamp, "translation", time / FPS, np.column_stack([-1.6 * np.cos(turn), 2.2 - 0.2 * np.sin(turn), 0.9 * np.cos(turn)]))
    b.camera((2.6, 1.75, 1.85), (-0.9, 0.65, -0.7), np.radians(62))
    return b.build(fps=FPS, frames=frames)


def _furniture(b: SceneBuilder, wood: int) -> None:
    """A table with five chairs, and a shelf along the back wall."""
    leg = _leg(TABLE_TOP - 0.04)
    legs = [moved(leg, (x, 0, z)) for x in (-1, 1) for z in (-0.45, 0.45)]
    top = box((-1.1, TABLE_TOP - 0.04, -0.55), (1.1, TABLE_TOP, 0.55), 0.1)
    b.place(merge(top, *legs), wood, "table")
    cloth = b.material(Lambert("seat", (0.2, 0.35, 0.25)))
    frame = b.shape(_chair(), wood, "chair")
    seat = b.shape(box((-0.22, SEAT, -0.22), (0.22, SEAT + 0.05, 0.22), 0.05), cloth, "seat")
    for x, z, angle in CHAIRS:
        x_axis, y_axis, z_axis, w = (float(v) for v in yaw(np.array([angle]))[0])
        b.node(name="chair", meshes=(frame, seat), translation=(x, 0.0, z), rotation=(x_axis, y_axis, z_axis, w))
    boards = [box((-2.6, y, -2.0), (1.2, y + 0.03, -1.7), 0.1) for y in (0.4, 0.9, 1.4, 1.9)]
    sides = [box((x, 0, -2.0), (x + 0.03, 1.93, -1.7), 0.1) for x in (-2.63, 1.2)]
    b.place(merge(*boards, *sides), wood, "shelf")


def _leg(height: float, radius: float = 0.035) -> Shape:
    """A turned leg, standing in the origin."""
    t = np.linspace(0, 1, 25)
    return lathe(np.column_stack([radius * (0.75 + 0.25 * np.cos(14 * t) * np.sin(np.pi * t)), height * t]), 16)


def _chair() -> Shape:
    """Legs, and a back of three bent rails between two posts; its front is +Z."""
    legs = [moved(_leg(SEAT, 0.025), (x, 0, z)) for x in (-0.19, 0.19) for z in (-0.19, 0.19)]
    posts = [moved(_leg(0.5, 0.02), (x, SEAT + 0.05, -0.2)) for x in (-0.19, 0.19)]
    bend = np.linspace(-1, 1, 13)
    rails = [
        tube(np.column_stack([0.19 * bend, np.full(13, y), -0.2 - 0.04 * (1 - bend**2)]), 0.015, 10) for y in (0.62, 0.77, 0.92)
    ]
    return merge(*legs, *posts, *rails)


def _crockery(b: SceneBuilder) -> None:
    """Vases on the shelf and on the table, glossy, and bowls between them."""
    t = np.linspace(0, 1, len(VASE_RADII))
    fine = np.linspace(0, 1, 40)
    vase = lathe(np.column_stack([np.interp(fine, t, VASE_RADII), 0.34 * fine]), 40)
    outside = np.column_stack([0.05 + 0.09 * np.sqrt(fine), 0.1 * fine])
    inside = np.column_stack([0.05 + 0.09 * np.sqrt(fine), 0.004 + 0.096 * fine])[::-1]
    bowl = merge(lathe(outside, 36), lathe(np.concatenate([inside, [(0.002, 0.004)]]), 36))
    glazes = [
        Phong("blue glaze", diffuse=(0.08, 0.15, 0.4), specular=(0.3,) * 3, exponent=40.0),
        Phong("ochre glaze", diffuse=(0.5, 0.3, 0.08), specular=(0.3,) * 3, exponent=40.0),
    ]
    vases = [b.shape(vase, b.material(glaze), "vase") for glaze in glazes]
    bowls = b.shape(bowl, b.material(Lambert("clay", (0.6, 0.35, 0.25))), "bowl")
    for k in range(14):
        row, column = divmod(k, 5)
        where = (-2.3 + 0.75 * column + 0.1 * row, 0.43 + 0.5 * row, -1.85)
        b.node(name="shelf", meshes=(vases[k % 2] if k % 3 else bowls,), translation=where)
    for k, (x, z) in enumerate(((-0.7, 0.1), (0.0, -0.1), (0.65, 0.15))):
        b.node(name="table", meshes=(bowls if k == 1 else vases[k % 2],), translation=(x, TABLE_TOP, z))


def _props(b: SceneBuilder, frames: int) -> None:
    """The ball before the table, and the top at its end."""
    time = np.arange(frames + 1)
    red, yellow = b.material(Lambert("red", (0.7, 0.1, 0.08))), b.material(Lambert("yellow", (0.75, 0.6, 0.12)))
    way = 2 * np.pi * 3 * time / frames
    path = np.column_stack([1.3 * np.sin(way), np.full(frames + 1, 0.16), np.full(frames + 1, 1.35)])
    ball = b.place(sphere(0.16, 40, 20), red, "ball", translation=tuple(path[0]))
    b.animate(ball, "translation", time / FPS, path)
    t = np.linspace(0, 1, 30)
    round_top = lathe(np.column_stack([0.003 + 0.14 * np.sin(np.pi * t**1.5) * (1 - 0.3 * t), 0.3 * t]), 32)
    circle = 2 * np.pi * 5 * time / frames
    path = np.column_stack([1.55 + 0.3 * np.cos(circle), np.full(frames + 1, 0.002), -0.75 + 0.3 * np.sin(circle)])
    handle = box((-0.2, 0.14, -0.02), (0.2, 0.18, 0.02))
    top = b.place(merge(round_top, handle), yellow, "top", translation=tuple(path[0]))
    b.animate(top, "translation", time / FPS, path)
    b.animate(top, "rotation", time / FPS, yaw(7 * circle))
