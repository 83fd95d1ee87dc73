"""Points spread evenly over a World's surfaces: how much surface lies in a zone, whatever its shape.

The convex hull of a zone's photons measures flat convex regions well. On a narrow curved surface it spans the gaps between facets,
or is a sliver of three photons. There the area is counted instead: each point that passes the zone's filter stands for an equal
share of the scene's area, A = m · share, relative noise 1/√m, less since the points are stratified along the triangles.

Only scenes with curved surfaces have such points. Surface that nothing can light (the floor under a block) counts as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.photons.tree import Tree, build, within
from renderers.transport.sampling import generator

PER_PHOTON, MOST = 4, 1 << 20


class Surface(NamedTuple):
    """tree over the points; share: area that each stands for, World units²."""

    tree: Tree
    share: float


def _none() -> Surface:
    three = np.zeros((0, 3), np.float32)
    return Surface(Tree(np.zeros(0, np.int8), np.zeros(0, np.float32), 0, three, three), 0.0)


UNMEASURED = _none()


def curved(world: World) -> NDArray[np.bool_]:
    """Triangles with a vertex normal that isn't the face's (by more than 0.6°), bool (T,)."""
    cosine = np.einsum("tvc,tc->tv", world.normals[world.triangles].astype(np.float64), world.face_normals)
    return np.asarray((np.abs(cosine) < np.cos(0.01)).any(axis=1))


def surface_of(world: World, photons: int) -> Surface:
    """Points for a map of so many photons, PER_PHOTON each up to MOST; UNMEASURED where all surfaces are flat."""
    count = min(PER_PHOTON * photons, MOST)
    if not count or not curved(world).any():
        return UNMEASURED
    position, normal = spread(world, count)
    axis, split, levels, order = build(position)
    return Surface(Tree(axis, split, levels, position[order], normal[order]), float(world.areas.sum()) / count)


def spread(world: World, count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Positions and unit shading normals float32 (count, 3), uniform by area, one in each of `count` equal shares of it."""
    random, ends = generator(0, "surface points").random((count, 3)), np.cumsum(world.areas)
    chosen = np.searchsorted(ends, (np.arange(count) + random[:, 0]) / count * ends[-1], side="right")
    corners = world.triangles[np.minimum(chosen, len(ends) - 1)]
    side = np.sqrt(random[:, 1])
    weight = np.stack([1 - side, side * (1 - random[:, 2]), side * random[:, 2]], axis=1)
    position, normal = (np.einsum("nk,nkc->nc", weight, a[corners].astype(np.float64)) for a in (world.positions, world.normals))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return position.astype(np.float32), normal.astype(np.float32)


@numba.njit(nogil=True, cache=True)
def measured_area(ground, share, p, n, radius, cos_min, height):  # type: ignore[no-untyped-def]
    """Area of the surface within `radius` of p that passes the filter, from either side; 0 where no point does."""
    found, front = within(ground, p, n, radius, cos_min, height, np.empty(256, np.int64))
    found, back = within(ground, p, -n, radius, cos_min, height, found)
    return (front + back) * share
