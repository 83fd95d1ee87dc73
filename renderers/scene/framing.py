"""Make a loaded scene renderable: check its size, frame a view where the file has no camera, say where it has no light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderers.scene.builder import look_rotation
from renderers.scene.model import Camera, DiscLight, Node, PointLight, Scene, SceneError, SphereLight
from renderers.scene.needs import needs_of
from renderers.scene.world import rest_bounds

MIN_RADIUS, MAX_RADIUS = 1e-12, 1e12
MAX_PLACED_TRIANGLES = 20_000_000
FRAMING_YFOV = 0.7
FRAMING_DIRECTION = np.array([0.45, 0.35, 0.82])
LIGHT_NEEDS = frozenset({"point_light", "directional_light", "spot_light", "area_light", "environment"})


def checked(scene: Scene, file: str) -> Scene:
    """The scene itself. Raises SceneError when it places more than MAX_PLACED_TRIANGLES or its size leaves the supported range."""
    placed = sum(len(scene.meshes[i].triangles) for node in scene.nodes for i in node.meshes)
    if placed > MAX_PLACED_TRIANGLES:
        raise SceneError(f"{file}: scene: {placed} placed triangles, more than the limit of {MAX_PLACED_TRIANGLES}")
    if has_geometry(scene):
        radius = rest_bounds(scene)[1]
        if not MIN_RADIUS <= radius <= MAX_RADIUS:
            raise SceneError(f"{file}: scene: half diagonal {radius:.3g} m is outside {MIN_RADIUS:g} to {MAX_RADIUS:g} m")
    return scene


def completed(scene: Scene, *, headlight: bool = False) -> Scene:
    """The scene with a view framed from its bounding box if it has no camera, and notes on what it lacks.

    With `headlight`, a scene without light gets a point light above the camera: about π W/m² at the centre.
    """
    if not has_geometry(scene):
        return scene.with_notes("scene has no geometry")
    if all(node.camera is None for node in scene.nodes):
        scene = framed(scene).with_notes("no camera: a view is framed from the bounding box")
    if not needs_of(scene) & LIGHT_NEEDS:
        if headlight:
            return lit(scene).with_notes("no light: a point light is added above the camera")
        return scene.with_notes("no light: the image is black")
    return scene


def has_geometry(scene: Scene) -> bool:
    """Whether anything with a surface is placed."""
    for node in scene.nodes:
        if any(len(scene.meshes[i].triangles) for i in node.meshes):
            return True
        if node.light is not None and isinstance(scene.lights[node.light], DiscLight | SphereLight):
            return True
    return False


def framed(scene: Scene) -> Scene:
    """The scene with a camera that sees its whole bounding sphere in a landscape or square image."""
    centre, radius = rest_bounds(scene)
    direction = FRAMING_DIRECTION / np.linalg.norm(FRAMING_DIRECTION)
    eye = centre + direction * radius / np.sin(FRAMING_YFOV / 2)
    x, y, z = (float(v) for v in eye)
    node = Node("framed camera", translation=(x, y, z), rotation=look_rotation(-direction), camera=len(scene.cameras))
    return replace(scene, nodes=(*scene.nodes, node), cameras=(*scene.cameras, Camera("framed camera", FRAMING_YFOV)))


def lit(scene: Scene) -> Scene:
    """The scene with a point light two radii above and beside its centre, towards the framed view."""
    centre, radius = rest_bounds(scene)
    x, y, z = (float(v) for v in centre + radius * np.array([0.3, 1.8, 0.8]))
    light = PointLight("headlight", intensity=float(np.pi * 4 * radius**2))
    node = Node("headlight", translation=(x, y, z), light=len(scene.lights))
    return replace(scene, nodes=(*scene.nodes, node), lights=(*scene.lights, light))
