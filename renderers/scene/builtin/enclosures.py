"""Closed scenes whose radiance is known exactly: the white furnace and concentric spheres. Flat normals keep them exact."""

from __future__ import annotations

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.solids import box, flipped, moved
from renderers.scene.model import BLACK, Lambert, PointLight, Scene
from renderers.scene.shapes import Shape, sphere


@checked(albedo=(0.0, 0.99), emission=(0.0, 1e6), shape=("clutter", "box", "sphere"))
def furnace(albedo: float = 0.5, emission: float = 1.0, shape: str = "clutter") -> Scene:
    """White furnace: closed room, all surfaces of one albedo and emission; radiance is exactly emission / (1 - albedo) everywhere.

    `shape`: box, sphere, or clutter (a box that holds a sphere and two blocks: concave corners, contacts, occlusion; the answer
    is the same). Exact: `exact.furnace_radiance(albedo, emission)`.
    """
    b = SceneBuilder("furnace")
    grey = b.material(Lambert("grey", albedo=(albedo,) * 3, emission=(emission,) * 3, double_sided=False))
    if shape == "sphere":
        b.node(meshes=(_faceted(b, flipped(sphere(1.0, 48, 24)), grey),), name="shell")
    else:
        b.place(flipped(box((-1, -1, -1), (1, 1, 1))), grey, "room")
    if shape == "clutter":
        b.node(meshes=(_faceted(b, moved(sphere(0.35, 32, 16), (0.4, -0.65, -0.3)), grey),), name="ball")
        b.place(box((-0.7, -0.999, -0.6), (-0.2, 0.1, -0.2)), grey, "block")
        b.place(box((-0.5, 0.1005, -0.5), (0.6, 0.2, -0.3)), grey, "beam")
    b.camera((0.1, 0.05, 0.85), (0, -0.1, 0), np.radians(60))
    return b.build(albedo=albedo, emission=emission, shape=shape)


@checked(source=("sphere", "point"), inner=(0.01, 0.9), albedo=(0.0, 0.99), radiance=(0.0, 1e6), segments=(8, 1024))
def sphere_in_sphere(
    source: str = "sphere", inner: float = 0.3, albedo: float = 0.5, radiance: float = 1.0, segments: int = 96
) -> Scene:
    """Black emitting sphere, or point light, in the centre of a closed diffuse sphere of radius 1: irradiance is uniform and exact.

    source sphere: `exact.enclosed_sphere_irradiance(inner, 1, albedo, radiance, bounces)`; source point (`radiance` is its
    intensity): `exact.integrating_sphere_irradiance(1, albedo, radiance, bounces)`. Outgoing radiance is albedo / π times that.
    Both spheres are facets of exact total area; the mean over the sphere is exact for source sphere, single facets deviate by
    O(1 / segments²).
    """
    b = SceneBuilder("sphere-in-sphere")
    wall = b.material(Lambert("wall", albedo=(albedo,) * 3))
    b.node(meshes=(_faceted(b, flipped(sphere(1.0, segments, segments // 2)), wall),), name="shell")
    if source == "sphere":
        lamp = b.material(Lambert("lamp", albedo=BLACK, emission=(radiance,) * 3, double_sided=False))
        b.node(meshes=(_faceted(b, sphere(inner, segments, segments // 2), lamp),), name="lamp")
    else:
        b.light(PointLight("lamp", intensity=radiance))
    b.camera((0.0, 0.3, 0.93), (0, 0.0, 0), np.radians(75))
    return b.build(source=source, inner=inner, albedo=albedo, radiance=radiance, segments=segments)


def _faceted(b: SceneBuilder, shape: Shape, material: int) -> int:
    """Mesh with flat normals: interpolated ones would turn the cosine away from the surface that closes the enclosure."""
    return b.mesh(shape[0], shape[2], material)
