"""The Cornell box: dimensions in metres, as measured at Cornell University."""

from __future__ import annotations

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, PointLight, Scene


def cornell_box(light: str = "point") -> Scene:
    """Cornell box with measured dimensions and reflectances; `light`: point or area."""
    b = SceneBuilder("cornell-box")
    white = b.material(Lambert("white", (0.725, 0.71, 0.68)))
    red = b.material(Lambert("red", (0.63, 0.065, 0.05)))
    green = b.material(Lambert("green", (0.14, 0.45, 0.091)))
    x, y, z = 0.5528, 0.5488, 0.5592
    b.quad([(0, 0, 0), (0, 0, z), (x, 0, z), (x, 0, 0)], white, "floor")
    b.quad([(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)], white, "ceiling")
    b.quad([(0, 0, z), (0, y, z), (x, y, z), (x, 0, z)], white, "back")
    b.quad([(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)], green, "right")
    b.quad([(x, 0, 0), (x, 0, z), (x, y, z), (x, y, 0)], red, "left")
    short = [(0.130, 0.065), (0.082, 0.225), (0.240, 0.272), (0.290, 0.114)]
    tall = [(0.423, 0.247), (0.265, 0.296), (0.314, 0.456), (0.472, 0.406)]
    for name, ring, height in (("short box", short, 0.165), ("tall box", tall, 0.330)):
        b.quad([(px, height, pz) for px, pz in ring], white, name)
        for (ax, az), (bx, bz) in zip(ring, ring[1:] + ring[:1], strict=True):
            b.quad([(ax, 0, az), (bx, 0, bz), (bx, height, bz), (ax, height, az)], white, name)
    b.light(PointLight("lamp", (1.0, 0.85, 0.6), 0.3), (0.278, 0.5, 0.2795))
    b.camera((0.278, 0.273, -0.800), (0.278, 0.273, 0.0), 0.686)
    return b.build(light=light)
