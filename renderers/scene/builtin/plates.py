"""Planes and rectangles with closed-form irradiance; the formulas are in `exact`."""

from __future__ import annotations

import numpy as np

from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.builtin.parameters import checked
from renderers.scene.model import BLACK, Color, DirectionalLight, Lambert, Scene

GREY = (0.6, 0.6, 0.6)


@checked(light=("directional", "area"), side=(0.01, 100.0), distance=(0.001, 100.0), albedo=(0.0, 1.0))
def parallel_plates(light: str = "directional", side: float = 1.0, distance: float = 1.0, albedo: float = 0.5) -> Scene:
    """Two opposed squares without contact; the lower one receives from the upper one exactly what a formula says.

    light area: the upper plate is black and emits radiance 1. light directional: a slanted beam from below passes beside the
    lower plate and lights the whole underside of the upper one with irradiance π, so that it reflects the uniform radiance
    `albedo`; the lower plate's upper side gets no direct light. In both cases E(p) on the lower plate is
    `exact.parallel_plates_irradiance(p, side, distance, L)`, L = 1 or albedo, its mean π·L·`exact.parallel_plates_form_factor(side,
    distance)`, its radiance albedo / π · E: direct light (area), exactly one bounce (directional).
    """
    b = SceneBuilder("parallel-plates")
    grey = b.material(Lambert("grey", (albedo,) * 3))
    emitter = Lambert("emitter", albedo=BLACK, emission=(1.0, 1.0, 1.0), double_sided=False)
    h = side / 2
    b.quad([(-h, 0, -h), (-h, 0, h), (h, 0, h), (h, 0, -h)], grey, "receiver")
    upper = b.material(emitter) if light == "area" else grey
    b.quad([(-h, distance, -h), (h, distance, -h), (h, distance, h), (-h, distance, h)], upper, "source")
    if light == "directional":
        # a ray that meets the source comes from 1.5 sides further left at the receiver's height: the receiver casts no shadow on it
        direction = np.array([1.5 * side, distance, 0.0])
        cosine = distance / float(np.linalg.norm(direction))
        b.light(DirectionalLight("beam", intensity=np.pi / cosine), rotation=look_rotation(direction))
    b.camera((0.6 * side, 0.66 * distance, 1.9 * side), (0, 0.52 * distance, 0), np.radians(47))
    return b.build(light=light, side=side, distance=distance, albedo=albedo)


@checked(
    width=(0.01, 100.0), depth=(0.01, 100.0), height=(0.01, 100.0), radiance=(0.0, 1e6), albedo=(0.0, 1.0), occluder=(0.0, 100.0)
)
def rectangle_light(
    width: float = 1.0, depth: float = 0.6, height: float = 1.0, radiance: float = 5.0, albedo: float = 0.6, occluder: float = 0.4
) -> Scene:
    """Black rectangle emitter above a plane, with a square black occluder at half height: exact irradiance, penumbra included.

    `occluder` is the side of the square; 0 leaves it out. The floor's radiance is albedo / π ·
    `exact.rectangle_irradiance(p, width, depth, height, radiance, occluder)` in every Transport but the unoccluded and the ambient
    one: nothing but the floor reflects.
    """
    b = SceneBuilder("rectangle-light")
    floor = b.material(Lambert("floor", (albedo,) * 3))
    lamp = b.material(Lambert("lamp", albedo=BLACK, emission=(radiance,) * 3, double_sided=False))
    size = 2.5 * max(width, depth, height)
    _level(b, size, size, 0.0, floor, "floor", up=True)
    _level(b, width / 2, depth / 2, height, lamp, "lamp", up=False)
    if occluder:
        _level(b, occluder / 2, occluder / 2, height / 2, b.material(Lambert("black", BLACK)), "occluder", up=False)
    b.camera((0.3 * size, 0.7 * height, 0.7 * size), (0, 0.5 * height, 0), np.radians(46))
    return b.build(width=width, depth=depth, height=height, radiance=radiance, albedo=albedo, occluder=occluder)


@checked(angle=(5.0, 175.0), side=(0.01, 100.0), light=("directional", "area"))
def corner(angle: float = 90.0, side: float = 1.0, light: str = "directional") -> Scene:
    """Two squares in contact along an edge at `angle` degrees: 1/r² is singular at the contact, and the answer is exact.

    light directional: along the bisector, unshadowed, irradiance π · sin(angle / 2) on both; the reddish wall (albedo 0.8, 0.3,
    0.2) then has the uniform direct radiance w = albedo · sin(angle / 2), and one bounce adds to the floor (albedo 0.6) 0.6 / π ·
    `exact.corner_irradiance(p, angle, side, w)`. light area: the wall is black and emits radiance 1; the floor gets that
    formula, w = 1.
    """
    b = SceneBuilder("corner")
    grey = b.material(Lambert("floor", GREY))
    red: Color = (0.8, 0.3, 0.2)
    wall = Lambert("wall", red) if light == "directional" else Lambert("wall", BLACK, emission=(1.0, 1.0, 1.0), double_sided=False)
    h, turn, middle = side / 2, np.radians(angle), np.radians(angle / 2)
    top, lean = side * np.sin(turn), side * np.cos(turn)
    b.quad([(-h, 0, 0), (-h, 0, side), (h, 0, side), (h, 0, 0)], grey, "floor")
    b.quad([(-h, 0, 0), (h, 0, 0), (h, top, lean), (-h, top, lean)], b.material(wall), "wall")
    inward = np.array([0.0, np.sin(middle), np.cos(middle)])
    if light == "directional":
        b.light(DirectionalLight("sun", intensity=np.pi), rotation=look_rotation(-inward))
    target = 0.3 * side * inward
    b.camera(target + side * (2.3 * inward + np.array([0.9, 0.25, 0.1])), target, np.radians(42))
    return b.build(angle=angle, side=side, light=light)


def _level(b: SceneBuilder, x: float, z: float, y: float, material: int, name: str, *, up: bool) -> None:
    """Horizontal rectangle of half sizes x, z at height y, facing up or down."""
    ring = [(-x, y, -z), (-x, y, z), (x, y, z), (x, y, -z)]
    b.quad(ring if up else ring[::-1], material, name)
