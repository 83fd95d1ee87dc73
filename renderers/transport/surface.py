"""What a surface is at (triangle, u, v): position, normals, base colour. Textures as GL and Mitsuba look them up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.model import Texture
from renderers.scene.world import World

F64 = NDArray[np.float64]


class Surface(NamedTuple):
    """Surface points as arrays. position, normal (interpolated, unit), geometric (unit), base: float64 (N, 3); material int32 (N,).

    Normals point to the front (counter-clockwise) side, as modelled; `turned` flips them to a viewer.
    """

    position: F64
    normal: F64
    geometric: F64
    base: F64
    material: NDArray[np.int32]


def surface_at(world: World, triangle: ArrayLike, u: ArrayLike, v: ArrayLike) -> Surface:
    """Interpolated surface at barycentrics (u of the second vertex, v of the third); triangle int (N,), u and v (N,)."""
    index = np.asarray(triangle, np.int64)
    second, third = np.asarray(u, np.float64), np.asarray(v, np.float64)
    weights = np.stack([1.0 - second - third, second, third], axis=-1)
    corners = world.triangles[index]

    def mixed(attribute: NDArray[np.float32]) -> F64:
        return np.asarray(np.einsum("nk,nkc->nc", weights, attribute[corners].astype(np.float64)))

    material = world.material[index]
    geometric = world.normals_of(index)
    normal = mixed(world.normals)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(
        length > 1e-6, normal / np.maximum(length, 1e-6), geometric
    )  # opposite vertex normals cancel: flat shading there
    return Surface(mixed(world.positions), normal, geometric, base_color(world, material, mixed(world.uvs)), material)


def base_color(world: World, material: NDArray[np.int32], uv: F64) -> F64:
    """Base colour × texture, linear, float64 (N, 3); material rows (N,), uv (N, 2)."""
    base = world.materials.base[material].astype(np.float64)
    texture = world.materials.texture[material]
    for index in np.unique(texture[texture >= 0]):
        rows = np.flatnonzero(texture == index)
        base[rows] *= look_up(world.textures[index], uv[rows])
    return base


def look_up(texture: Texture, uv: F64) -> F64:
    """Bilinear look-up in linear colour, float64 (N, 3). uv (N, 2): v = 0 is the upper edge of row 0, texel centres are at ½."""
    height, width = texture.pixels.shape[:2]
    columns, x = _neighbours(uv[:, 0], width, texture.wrap[0])
    rows, y = _neighbours(uv[:, 1], height, texture.wrap[1])
    t = texture.linear
    top = t[rows[0], columns[0]] * (1 - x) + t[rows[0], columns[1]] * x
    bottom = t[rows[1], columns[0]] * (1 - x) + t[rows[1], columns[1]] * x
    return np.asarray(top * (1 - y) + bottom * y, np.float64)


def turned(normals: F64, towards: F64) -> F64:
    """Normals (N, 3) flipped where normal·towards < 0: two-sided shading."""
    away = np.einsum("ij,ij->i", normals, towards) < 0
    return np.where(away[:, None], -normals, normals)


def _neighbours(coordinate: F64, size: int, wrap: str) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], F64]:
    texel = coordinate * size - 0.5
    low = np.floor(texel)
    index = low.astype(np.int64)
    return (_wrapped(index, size, wrap), _wrapped(index + 1, size, wrap)), (texel - low)[:, None]


def _wrapped(index: NDArray[np.int64], size: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "clamp":
        return np.clip(index, 0, size - 1)
    if wrap == "repeat":
        return np.asarray(np.mod(index, size))
    folded = np.mod(index, 2 * size)
    return np.asarray(np.minimum(folded, 2 * size - 1 - folded))
