"""Pixels whose surface was hidden a few frames ago: where an image that lives on earlier ones has nothing to live on, and ghosts.

A pixel's surface point stays with its triangle. It was hidden in an earlier frame when something stood between it and that frame's
camera, or when it lay outside of that frame's image. Only geometry and cameras reveal; a shadow that moves on does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.model import Scene
from renderers.scene.world import World
from renderers.transport.raycast import OFFSET, caster_of

BACK = (1, 2, 4, 8)  # frames back that are looked at


def revealed(scene: Scene, frame: int, size: tuple[int, int], begin: int = 0) -> NDArray[np.bool_] | None:
    """Pixels (H, W) whose surface was hidden in frame − 1, − 2, − 4 or − 8, none of them before `begin`; size is (width, height).

    None where nothing moves or no frame came before. An earlier frame with another number of triangles is left out.
    """
    earlier = [frame - back for back in BACK if frame - back >= begin]
    if not scene.channels or not earlier:
        return None
    world = scene.world(frame)
    origins, directions = (a.reshape(-1, 3) for a in world.camera.rays(size))
    hits = caster_of(world).first_hit(origins, directions)
    seen = np.flatnonzero(hits.triangle >= 0)
    triangles, u, v = hits.triangle[seen], hits.u[seen, None], hits.v[seen, None]
    hidden = np.zeros(len(seen), bool)
    for number in earlier:
        old = scene.world(number)
        if len(old.triangles) == len(world.triangles):
            a, b, c = (old.positions[old.triangles[triangles, k]].astype(np.float64) for k in range(3))
            hidden |= ~_visible(old, (1 - u - v) * a + u * b + v * c, size)
    found = np.zeros(size[0] * size[1], bool)
    found[seen] = hidden
    return found.reshape(size[1], size[0])


def _visible(world: World, points: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Whether the camera sees points (N, 3) of the surface in an image of this shape; OFFSET short of them all counts as free."""
    eye = world.camera.pose[:3, 3]
    towards = points - eye
    x, y, z = (towards @ world.camera.pose[:3, :3]).T
    tan = np.tan(world.camera.yfov / 2)
    inside = (z < 0) & (np.abs(y) <= -z * tan) & (np.abs(x) <= -z * tan * size[0] / size[1])
    distance = np.linalg.norm(towards, axis=1)
    origins = np.broadcast_to(eye, points.shape)
    # The points are float32 of a world of size 1: the last 10 offsets of the way belong to the surface itself, seen at a slant.
    blocked = caster_of(world).occluded(origins, towards / distance[:, None], distance - 10 * OFFSET)
    return np.asarray(inside & ~blocked)
