"""The surfaces that rays hit: `surface.surface_at` in one pass, with normals turned to where the rays came from."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.raycast import Hits
from renderers.transport.surface import base_color

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Seen(NamedTuple):
    """Hits of rays. ray int64 (S,): which ray; position (S, 3); normal (S, 3) shading, turned to where the ray came from;
    geometric (S, 3); towards (S, 3): unit, back along the ray: float64. material int32 (S,); base float64 (S, 3)."""

    ray: NDArray[np.int64]
    position: F64
    normal: F64
    geometric: F64
    towards: F64
    material: NDArray[np.int32]
    base: F64


def seen_along(world: World, directions: F32, hits: Hits, rays: NDArray[np.int64] | None = None) -> Seen:
    """The surfaces that rays with unit directions (N, 3) hit; rays (M,): only those, by default all."""
    rays = np.arange(len(directions)) if rays is None else rays
    count, table = len(rays), world.materials
    textured = bool((table.texture >= 0).any())
    position, normal, geometric, towards, base = (np.empty((count, 3)) for _ in range(5))
    seen = Seen(np.empty(count, np.int64), position, normal, geometric, towards, np.empty(count, np.int32), base)
    uv = np.empty((count if textured else 0, 2))
    geometry = world.positions, world.normals, world.uvs, world.triangles, world.face_normals, world.material, table.base
    found = _surfaces(seen, uv, hits, directions, rays, geometry)
    seen = Seen._make(column[:found] for column in seen)
    return seen._replace(base=base_color(world, seen.material, uv[:found])) if textured else seen


@numba.njit(nogil=True, cache=True)
def _surfaces(seen, uv, hits, direction, rays, geometry):  # type: ignore[no-untyped-def]
    """Fill the first places of `seen`, and of uv unless it is empty, with what some rays hit; returns how many do."""
    positions, normals, uvs, triangles, face_normals, material, base = geometry
    s = 0
    for r in rays:
        t, second, third = hits.triangle[r], float(hits.u[r]), float(hits.v[r])
        if t < 0:
            continue
        first = 1 - second - third
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        length, facing = 0.0, 0.0
        seen.ray[s], seen.material[s] = r, material[t]
        for x in range(3):
            seen.position[s, x] = first * positions[a, x] + second * positions[b, x] + third * positions[c, x]
            mixed = first * normals[a, x] + second * normals[b, x] + third * normals[c, x]
            seen.normal[s, x] = mixed
            length += mixed * mixed
            seen.geometric[s, x] = face_normals[t, x]
            seen.towards[s, x] = -float(direction[r, x])
            seen.base[s, x] = base[material[t], x]
        flat = length < 1e-12  # opposite vertex normals cancel: flat shading there
        scale = 1.0 if flat else 1 / np.sqrt(length)
        for x in range(3):
            seen.normal[s, x] = face_normals[t, x] if flat else seen.normal[s, x] * scale
            facing += seen.normal[s, x] * seen.towards[s, x]
        if facing < 0:
            for x in range(3):
                seen.normal[s, x] = -seen.normal[s, x]
        if len(uv):
            for x in range(2):
                uv[s, x] = first * uvs[a, x] + second * uvs[b, x] + third * uvs[c, x]
        s += 1
    return s
