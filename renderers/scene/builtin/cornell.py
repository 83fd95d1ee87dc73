"""The Cornell box as measured at Cornell University (published in millimetres and 4 nm spectra; here metres and linear Rec.709).

Reflectances are the measured spectra under illuminant D65, the lamp's radiance is its published spectrum, both through the CIE 1931
observer. The walls aren't quite square: the left one leans by 3 mm, as published.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.parameters import checked
from renderers.scene.model import BLACK, Lambert, Material, Phong, PointLight, Scene

WHITE = (0.737, 0.737, 0.738)
RED = (0.493, 0.049, 0.051)
GREEN = (0.068, 0.398, 0.086)
LAMP_RADIANCE = (20.73, 10.86, 2.77)
# camera: focal length 0.035 on a film 0.025 high
YFOV = 2 * float(np.arctan(0.0125 / 0.035))
HEIGHT, DEPTH = 0.5488, 0.5592
LAMP = (0.213, 0.343, 0.227, 0.332)
SHORT = ((0.130, 0.065), (0.082, 0.225), (0.240, 0.272), (0.290, 0.114))
TALL = ((0.423, 0.247), (0.265, 0.296), (0.314, 0.456), (0.472, 0.406))


@checked(light=("point", "area"))
def cornell_box(light: str = "point") -> Scene:
    """Cornell box with measured dimensions and reflectances; `light`: point (near the ceiling) or area (the measured lamp)."""
    return _box("cornell-box", light, Lambert("back", WHITE))


@checked(light=("point", "area"), exponent=(1.0, 1000.0))
def cornell_glossy(light: str = "point", exponent: float = 20.0) -> Scene:
    """Cornell box whose back wall is glossy: Phong of `exponent` 20, diffuse 0.2 and specular 0.6, the other walls as measured."""
    back = Phong("back", diffuse=(0.2, 0.2, 0.2), specular=(0.6, 0.6, 0.6), exponent=exponent)
    return replace(_box("cornell-glossy", light, back), parameters={"light": light, "exponent": exponent})


def _box(name: str, light: str, back: Material) -> Scene:
    b = SceneBuilder(name)
    white, red, green = (b.material(Lambert(n, c)) for n, c in (("white", WHITE), ("red", RED), ("green", GREEN)))
    y, z = HEIGHT, DEPTH
    b.quad([(0, 0, 0), (0, 0, z), (0.5496, 0, z), (0.5528, 0, 0)], white, "floor")
    b.quad([(0.5496, 0, z), (0, 0, z), (0, y, z), (0.556, y, z)], b.material(back), "back")
    b.quad([(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)], green, "right")
    b.quad([(0.5528, 0, 0), (0.5496, 0, z), (0.556, y, z), (0.556, y, 0)], red, "left")
    if light == "area":
        _ceiling_with_lamp(b, white)
    else:
        b.quad([(0, y, 0), (0.556, y, 0), (0.556, y, z), (0, y, z)], white, "ceiling")
        b.light(PointLight("lamp", (1.0, 0.85, 0.6), 0.3), (0.278, 0.5, 0.2795))
    for label, ring, height in (("short box", SHORT, 0.165), ("tall box", TALL, 0.330)):
        b.quad([(px, height, pz) for px, pz in ring], white, label)
        for (ax, az), (bx, bz) in zip(ring, ring[1:] + ring[:1], strict=True):
            b.quad([(ax, height, az), (ax, 0, az), (bx, 0, bz), (bx, height, bz)], white, label)
    b.camera((0.278, 0.273, -0.800), (0.278, 0.273, 0.0), YFOV)
    return b.build(light=light)


def _ceiling_with_lamp(b: SceneBuilder, white: int) -> None:
    """The lamp lies in the ceiling's plane, so the ceiling is cut around it: four pieces and the emitter, no overlap."""
    y, x0, x1, z0, z1 = HEIGHT, *LAMP
    lamp = b.material(Lambert("lamp", albedo=BLACK, emission=LAMP_RADIANCE, double_sided=False))
    for left, right, front, rear, material, name in (
        (0.0, 0.556, 0.0, z0, white, "ceiling"), (0.0, 0.556, z1, DEPTH, white, "ceiling"),
        (0.0, x0, z0, z1, white, "ceiling"), (x1, 0.556, z0, z1, white, "ceiling"), (x0, x1, z0, z1, lamp, "lamp"),
    ):  # fmt: skip
        b.quad([(left, y, front), (right, y, front), (right, y, rear), (left, y, rear)], material, name)
