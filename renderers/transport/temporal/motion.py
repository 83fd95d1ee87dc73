"""What differs between the Worlds of two successive frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World

F32 = NDArray[np.float32]
MARGIN = 1e-4


@dataclass(frozen=True, eq=False)
class Motion:
    """From `before` to `after`.

    same_topology: triangles correspond, so that a hit on one can be followed. moved bool (T,): triangles with a vertex that moved
    (all, where the topology changed). boxes float32 (N, 2, 3): low and high corner of what moved, before and after in turn, a pair
    for each instance. lights, materials: whether those changed.
    """

    before: World
    after: World
    same_topology: bool
    moved: NDArray[np.bool_]
    boxes: F32
    lights: bool
    materials: bool

    @property
    def still(self) -> bool:
        """Nothing changed but perhaps the camera: light is the same everywhere."""
        return self.same_topology and not (self.lights or self.materials or self.moved.any())


def motion_between(before: World, after: World) -> Motion:
    """Compare two Worlds of one scene."""
    if before is after:
        nothing = np.zeros(len(before.triangles), bool)
        return Motion(before, after, True, nothing, np.zeros((0, 2, 3), np.float32), False, False)
    lights, materials = not _same_lights(before, after), not _same_materials(before, after)
    same = (
        np.array_equal(before.triangles, after.triangles)
        and np.array_equal(before.instance, after.instance)
        and np.array_equal(before.material, after.material)
    )
    if not same:
        boxes = np.stack([np.full(3, -np.inf), np.full(3, np.inf)]).astype(np.float32)[None]
        return Motion(before, after, False, np.ones(len(before.triangles), bool), boxes, lights, materials)
    shifted = (before.positions != after.positions).any(axis=1) | (before.normals != after.normals).any(axis=1)
    moved = shifted[before.triangles].any(axis=1)
    lights = lights or bool(moved[before.emissive].any())
    return Motion(before, after, True, moved, _boxes(before, after, moved), lights, materials)


def _boxes(before: World, after: World, moved: NDArray[np.bool_]) -> F32:
    boxes = []
    for instance in np.unique(before.instance[moved]):
        corners = np.unique(before.triangles[moved & (before.instance == instance)])
        for world in (before, after):
            points = world.positions[corners]
            boxes.append(np.stack([points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN]))
    return np.asarray(boxes, np.float32).reshape(-1, 2, 3)


def _same_lights(a: World, b: World) -> bool:
    def described(world: World) -> list[tuple[object, ...]]:
        return [
            (x.kind, *x.position.tolist(), *x.direction.tolist(), *x.intensity.tolist(), x.cos_inner, x.cos_outer)
            for x in world.lights
        ]

    return described(a) == described(b) and a.environment is b.environment


def _same_materials(a: World, b: World) -> bool:
    one, other = a.materials, b.materials
    same = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__)
    return same and all(x is y for x, y in zip(a.textures, b.textures, strict=True))
