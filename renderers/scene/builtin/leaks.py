"""Rooms divided by a thin wall: light must not leak."""

from __future__ import annotations

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.rooms import open_room
from renderers.scene.builtin.solids import box, quads_shape
from renderers.scene.model import Lambert, PointLight, Scene


@checked(thickness=(0.0, 0.5))
def thin_wall(thickness: float = 0.01) -> Scene:
    """Two rooms that share a thin wall, the right one lit: the left one is exactly black in every Transport with visibility.

    `thickness` in metres, 0 for a single sheet. The rooms are 1 m wide, open to the camera; no straight line joins them but
    through the wall, so no light path does.
    """
    b = SceneBuilder("thin-wall")
    white, red, blue = (
        b.material(Lambert(n, c)) for n, c in (("white", (0.7,) * 3), ("red", (0.6, 0.12, 0.08)), ("blue", (0.1, 0.2, 0.6)))
    )
    open_room(b, (-1, 0, -1), (1, 1, 0), white=white, left=blue, right=red)
    half = thickness / 2
    if thickness:
        b.place(box((-half, 0, -1), (half, 1, 0)), white, "wall")
    else:
        b.place(quads_shape([[(0, 0, -1), (0, 0, 0), (0, 1, 0), (0, 1, -1)]]), white, "wall")
    for x in (-0.55, 0.55):
        b.place(box((x - 0.15, 0, -0.7), (x + 0.15, 0.35, -0.4)), white, "block")
    b.light(PointLight("lamp", (1.0, 0.9, 0.75), 0.6), (0.5, 0.85, -0.5))
    b.camera((0.35, 0.55, 2.3), (0.0, 0.48, -0.3), np.radians(36))
    return b.build(thickness=thickness)
