"""What differs between the Worlds of two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World

F32 = NDArray[np.float32]
MARGIN = 1e-4


@dataclass(frozen=True, eq=False)
class Changes:
    """What differs between two frames.

    same_topology: triangles correspond, so that a hit on one can be followed. moved bool (T,): triangles with a vertex that moved
    (all, where the topology changed). boxes float32 (2 N, 2, 3): low and high corners of what moved, before and after in turn, a
    pair for each of N instances, owners int32 (N,), ascending. lights, materials: whether those changed.
    """

    same_topology: bool
    moved: NDArray[np.bool_]
    boxes: F32
    owners: NDArray[np.int32]
    lights: bool
    materials: bool

    @staticmethod
    def none(triangles: int) -> Changes:
        """Between a frame with so many triangles and itself."""
        return Changes(True, np.zeros(triangles, bool), np.zeros((0, 2, 3), np.float32), np.zeros(0, np.int32), False, False)

    @property
    def still(self) -> bool:
        """Nothing changed but perhaps the camera: light is the same everywhere."""
        return self.same_topology and not (self.lights or self.materials or self.moved.any())

    def then(self, later: Changes) -> Changes:
        """Both, one after the other: between the first frame of these and the last of those. What went and came back has moved."""
        lights, materials = self.lights or later.lights, self.materials or later.materials
        if not (self.same_topology and later.same_topology):
            return _all_new(max(len(self.moved), len(later.moved)), lights, materials)
        owners = np.union1d(self.owners, later.owners)
        boxes = np.empty((len(owners), 2, 2, 3), np.float32)
        mine, theirs = np.searchsorted(owners, self.owners), np.searchsorted(owners, later.owners)
        # one that moved in one of them alone rested where it was in the other
        boxes[theirs], boxes[mine, 0] = later.boxes.reshape(-1, 2, 2, 3), self.boxes[::2]
        alone = np.isin(self.owners, later.owners, invert=True)
        boxes[mine[alone], 1] = self.boxes[1::2][alone]
        return Changes(True, self.moved | later.moved, boxes.reshape(-1, 2, 3), owners, lights, materials)


@dataclass(frozen=True, eq=False)
class Motion(Changes):
    """From `before` to `after`."""

    before: World
    after: World


def motion_between(before: World, after: World) -> Motion:
    """Compare two Worlds of one scene."""
    if before is after:
        return Motion(**vars(Changes.none(len(before.triangles))), before=before, after=after)
    lights, materials = not _same_lights(before, after), not _same_materials(before, after)
    same = (
        np.array_equal(before.triangles, after.triangles)
        and np.array_equal(before.instance, after.instance)
        and np.array_equal(before.material, after.material)
    )
    if not same:
        return Motion(**vars(_all_new(len(before.triangles), lights, materials)), before=before, after=after)
    shifted = (before.positions != after.positions).any(axis=1) | (before.normals != after.normals).any(axis=1)
    moved = shifted[before.triangles].any(axis=1)
    lights = lights or bool(moved[before.emissive].any())
    owners = np.unique(before.instance[moved])
    return Motion(True, moved, _boxes(before, after, owners), owners, lights, materials, before, after)


def _all_new(triangles: int, lights: bool, materials: bool) -> Changes:
    """Between frames whose triangles don't correspond: a box around everything."""
    everywhere = np.array([[[-np.inf] * 3, [np.inf] * 3]] * 2, np.float32)
    return Changes(False, np.ones(triangles, bool), everywhere, np.zeros(1, np.int32), lights, materials)


def _boxes(before: World, after: World, owners: NDArray[np.int32]) -> F32:
    boxes = []
    for instance in owners:
        # all of it: which of its triangles keep their places, as on an axis it turns about, differs from frame to frame
        corners = np.unique(before.triangles[before.instance == instance])
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
