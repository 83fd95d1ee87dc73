"""An empty convex room: nothing occludes, so a method without indirect visibility has the same answer as one with it."""

from __future__ import annotations

import numpy as np

from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.builtin.parameters import checked
from renderers.scene.model import Color, Lambert, PointLight, Scene, SpotLight

SIZE = (6.0, 3.0, 4.0)
ALBEDOS: dict[str, Color] = {
    "west": (0.7, 0.25, 0.2), "east": (0.2, 0.35, 0.7), "south": (0.6, 0.6, 0.55), "north": (0.3, 0.6, 0.3),
    "floor": (0.5, 0.45, 0.4), "ceiling": (0.75, 0.75, 0.75),
}  # fmt: skip


@checked(light=("point", "spot"))
def empty_room(light: str = "point") -> Scene:
    """Empty 6 × 4 × 3 m room of six colours, lit by a point light or a narrow spot: convex, so nothing is ever occluded.

    `one-bounce` and `one-bounce-unoccluded` are the same here. The spot has a half-angle of 22° and a rim of 0.1°.
    """
    b = SceneBuilder("empty-room")
    paint = {name: b.material(Lambert(name, albedo)) for name, albedo in ALBEDOS.items()}
    x, y, z = SIZE
    b.quad([(0, 0, -z), (0, 0, 0), (x, 0, 0), (x, 0, -z)], paint["floor"], "floor")
    b.quad([(0, y, -z), (x, y, -z), (x, y, 0), (0, y, 0)], paint["ceiling"], "ceiling")
    b.quad([(0, 0, 0), (0, 0, -z), (0, y, -z), (0, y, 0)], paint["west"], "west")
    b.quad([(x, 0, -z), (x, 0, 0), (x, y, 0), (x, y, -z)], paint["east"], "east")
    b.quad([(x, 0, 0), (0, 0, 0), (0, y, 0), (x, y, 0)], paint["south"], "south")
    b.quad([(0, 0, -z), (x, 0, -z), (x, y, -z), (0, y, -z)], paint["north"], "north")
    if light == "point":
        b.light(PointLight("lamp", intensity=9.0), (2.2, 2.5, -1.4))
    else:
        spot = SpotLight("spot", intensity=60.0, inner_angle=float(np.radians(21.9)), outer_angle=float(np.radians(22)))
        b.light(spot, (0.6, 2.8, -0.8), look_rotation((3.4, -2.4, -2.2)))
    # 40° to either side at 16:9
    b.camera((5.7, 1.6, -3.7), (1.2, 1.2, -1.0), 2 * np.arctan(np.tan(np.radians(40)) * 9 / 16))
    return b.build(light=light)
