"""What differs between the Worlds of two successive frames, and which rays can't have noticed."""

from __future__ import annotations

from dataclasses import dataclass

import numba
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


@numba.njit(nogil=True, cache=True)
def crossing(origin, direction, reach, boxes, out):  # type: ignore[no-untyped-def]
    """out (N,) |= whether origin + s·direction, 0 ≤ s ≤ reach (N,), touches one of the boxes (B, 2, 3)."""
    for i in range(len(origin)):
        if out[i]:
            continue
        for b in range(len(boxes)):
            near, far = 0.0, float(reach[i])
            for c in range(3):
                d, o = float(direction[i, c]), float(origin[i, c])
                if d == 0.0:
                    if o < boxes[b, 0, c] or o > boxes[b, 1, c]:
                        far = -1.0
                    continue
                low, high = (boxes[b, 0, c] - o) / d, (boxes[b, 1, c] - o) / d
                near, far = max(near, min(low, high)), min(far, max(low, high))
            if near <= far:
                out[i] = True
                break
