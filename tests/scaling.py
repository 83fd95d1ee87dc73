"""A scene in other units: what a test of scale invariance renders."""

from __future__ import annotations

from dataclasses import replace

from renderers.scene.model import DirectionalLight, DiscLight, Light, Node, Scene, SphereLight


def scaled(scene: Scene, factor: float) -> Scene:
    """`scene` with every length multiplied by `factor` and every intensity by factor², so that its image doesn't change."""
    top = len(scene.nodes)
    nodes = tuple(replace(n, parent=top if n.parent is None else n.parent) for n in scene.nodes)
    return replace(
        scene,
        nodes=(*nodes, Node("scaled", scale=(factor, factor, factor))),
        lights=tuple(_scaled_light(light, factor) for light in scene.lights),
    )


def _scaled_light(light: Light, factor: float) -> Light:
    if isinstance(light, DirectionalLight):
        return light
    if isinstance(light, DiscLight | SphereLight):
        return light
    return replace(light, intensity=light.intensity * factor**2)
