"""What a scene needs, read off its content: methods skip the rest, and refuse or approximate what they can't do."""

from __future__ import annotations

import numpy as np

from renderers.scene.model import (
    Channel,
    DirectionalLight,
    DiscLight,
    Lambert,
    Material,
    Phong,
    PointLight,
    Scene,
    SphereLight,
    SpotLight,
)

SPECULAR_ROUGHNESS = 0.1
LIGHT_NEEDS = {
    PointLight: "point_light",
    SpotLight: "spot_light",
    DirectionalLight: "directional_light",
    DiscLight: "area_light",
    SphereLight: "area_light",
}


def needs_of(scene: Scene) -> frozenset[str]:
    """The subset of NEEDS that `scene` has; only placed lights and used materials count."""
    used = {scene.meshes[i].material for node in scene.nodes for i in node.meshes}
    found = set[str]()
    for index in used:
        found |= _material_needs(scene.materials[index])
    for node in scene.nodes:
        if node.light is not None:
            light = scene.lights[node.light]
            if light.intensity > 0 and any(light.color):
                found.add(LIGHT_NEEDS[type(light)])
    if scene.environment is not None and any(scene.environment.radiance):
        found.add("environment")
    return frozenset(found | _animation_needs(scene))


def _material_needs(material: Material) -> set[str]:
    found = {"area_light"} if any(material.emission) else set()
    if isinstance(material, Lambert):
        found.add("diffuse")
    elif isinstance(material, Phong):
        if any(material.diffuse):
            found.add("diffuse")
        if any(material.specular):
            found.add("glossy")
    else:
        if material.metallic < 1:
            found.add("diffuse")
        found.add("specular" if material.roughness < SPECULAR_ROUGHNESS else "glossy")
    return found


def _animation_needs(scene: Scene) -> set[str]:
    found = set()
    moving = {c.index for c in scene.channels if c.target == "node" and _moves(c)}
    for index, node in enumerate(scene.nodes):
        ancestor: int | None = index
        while ancestor is not None and ancestor not in moving:
            ancestor = scene.nodes[ancestor].parent
        if ancestor is None:
            continue
        shines = any(any(scene.materials[scene.meshes[i].material].emission) for i in node.meshes)
        if shines or node.light is not None:
            found.add("animated_light")
        if node.meshes:
            found.add("animated_geometry")
        if node.camera is not None:
            found.add("animated_camera")
    if any(c.target == "light" and _moves(c) for c in scene.channels):
        found.add("animated_light")
    if any(c.target == "camera" and _moves(c) for c in scene.channels):
        found.add("animated_camera")
    return found


def _moves(channel: Channel) -> bool:
    """Whether the value ever changes: keys differ, or a spline between equal keys swings out."""
    keys = channel.values
    if channel.interpolation != "CUBICSPLINE":
        return bool(np.ptp(keys, axis=0).any())
    return bool(np.ptp(keys[:, 1], axis=0).any() or (len(keys) > 1 and keys[:, [0, 2]].any()))
