"""Penumbra deep shadow maps of one emitter of a World: pyramids, shadow maps, functions; and their common lookup."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.world import World
from renderers.transport.penumbra.assemble import HALF_TEXELS, Construction, MapMaker, assemble
from renderers.transport.penumbra.cameras import cameras_of
from renderers.transport.penumbra.depth import depth_maps
from renderers.transport.penumbra.emitters import Emitter
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import aligned_cameras
from renderers.transport.penumbra.pyramid import Pyramid, pyramids_around

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Filter = Literal["bilinear", "nearest"]


@dataclass(frozen=True)
class Slope:
    """Bias of slanted surfaces, per texel (`depth`): limit is the largest bias in World units, 0: none."""

    limit: float = 0.2
    filter: Filter = "bilinear"


@dataclass(frozen=True, eq=False)
class LightShadows:
    """All pyramids around one emitter."""

    emitter: Emitter
    maps: tuple[PenumbraMap, ...]

    def hidden(self, points: ArrayLike, normals: ArrayLike | None = None, offset: float = 0.0, filter: Filter = "bilinear") -> F32:
        """Hidden share of the light at World points (P, 3), float32 (P,); -1 where no pyramid reaches.

        normals (P, 3), offset: as in `PenumbraMap.hidden`.
        """
        p = np.asarray(points, np.float64).reshape(-1, 3)
        n = None if normals is None else np.asarray(normals, np.float64).reshape(-1, 3)
        out = np.full(len(p), -1, np.float32)
        for shadow, (rows, _) in zip(self.maps, by_face(self.emitter, [m.pyramid for m in self.maps], p), strict=True):
            out[rows] = shadow.hidden(p[rows], filter, None if n is None else n[rows], offset)
        return out


def by_face(emitter: Emitter, pyramids: Sequence[Pyramid], points: F64) -> Iterator[tuple[NDArray[np.intp], F64]]:
    """For each pyramid around a light the rows of World points (P, 3) whose direction passes its face, and those in its frame."""
    reach = np.abs((points - emitter.centre) @ emitter.frame.T).max(axis=1)
    for pyramid in pyramids:
        local = pyramid.local(points)
        rows = np.flatnonzero(local[:, 2] >= reach * (1 - 1e-9))
        yield rows, local[rows]


def pyramids_of(world: World, emitter: Emitter, points: F64, resolution: int, near: float) -> list[Pyramid]:
    """Pyramids around `emitter` that hold all other geometry; parameters as in `build`."""
    others = np.ones(len(world.triangles), bool)
    others[emitter.triangles] = False
    geometry = world.positions[np.unique(world.triangles[others])].astype(np.float64)
    if not len(geometry):
        return []
    return pyramids_around(
        emitter.centre, emitter.frame, points, geometry, resolution, near * emitter.size, one_sided=emitter.one_sided
    )


def casters_of(world: World, emitter: Emitter, casters: NDArray[np.bool_] | None = None) -> F64:
    """Corners (T, 3, 3) of the triangles that cast shadows of `emitter`: all but its own, or those of `casters` (T,)."""
    cast = np.ones(len(world.triangles), bool) if casters is None else casters.copy()
    cast[emitter.triangles] = False
    return world.positions[world.triangles[cast]].astype(np.float64)


def build(
    world: World,
    emitter: Emitter,
    points: F64,
    *,
    resolution: int,
    map_resolution: int,
    how: Construction,
    slope: Slope,
    near: float = 1.0,
    casters: NDArray[np.bool_] | None = None,
    counters: Counter[str] | None = None,
) -> LightShadows:
    """Build the maps of `emitter` from light points (N, 3).

    resolution: pixels across 90° of a pyramid. map_resolution: texels across a shadow map, at least (their pitch fits the pixels).
    near: distance of the near plane from the light, in half sizes of the light. casters: bool (T,), which triangles cast (all but
    the emitter's own by default); the others receive.
    """
    pyramids = pyramids_of(world, emitter, points, resolution, near)
    corners = casters_of(world, emitter, casters)
    return LightShadows(emitter, tuple(_one(p, corners, points, map_resolution, how, slope, counters) for p in pyramids))


def _one(
    pyramid: Pyramid, corners: F64, points: F64, resolution: int, how: Construction, slope: Slope, counters: Counter[str] | None
) -> PenumbraMap:
    texels = HALF_TEXELS[how.walk]
    pixels = pyramid.pitch * (1.0 if slope.filter == "bilinear" else 0.5)
    local = pyramid.local(points)
    fitting = aligned_cameras(pyramid, local, resolution) if how.walk == "exact" else None
    if fitting is None:
        make = map_maker(pyramid, corners, (resolution, resolution), texels, pixels, slope.limit)
        return assemble(pyramid, cameras_of(pyramid, local, resolution), make, how, counters)
    cameras, grid = fitting
    return assemble(pyramid, cameras, map_maker(pyramid, corners, grid.shape, texels, pixels, slope.limit), how, counters, grid)


def map_maker(
    pyramid: Pyramid, corners: F64, shape: tuple[int, int], texels: float = 0.0, pixels: float = 0.0, limit: float = 0.2
) -> MapMaker:
    """Makes shadow maps float32 (N, *shape) of World triangles (T, 3, 3) for cameras; the rest as in
    `depth_maps`.
    """
    local = pyramid.local(corners)
    local = np.ascontiguousarray(local[(local[:, :, 2] > 0).any(axis=1)])

    def make(cameras: F64) -> F32:
        maps = np.empty((len(cameras), *shape), np.float32)
        depth_maps(local, np.ascontiguousarray(cameras), maps, texels, pixels, limit)
        return maps

    return make


@cache
def warm_up() -> None:
    """Compile (or load from numba's cache) all kernels on a map of a few pixels; once a process."""
    pyramid = Pyramid(np.zeros(3), np.eye(3), (-1.0, -1.0), 1.0, 2, 2, 1.0, 2.0)
    triangle = np.array([[[-9.0, -9, 1.5], [9, -9, 1.5], [0, 9, 1.5]]])
    for walk in ("exact", "midpoint"):
        _one(pyramid, triangle, np.zeros((1, 3)), 4, Construction(walk=walk), Slope(), None).hidden(np.ones((1, 3)))
