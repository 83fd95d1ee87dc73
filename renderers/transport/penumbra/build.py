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
from renderers.transport.penumbra.plan import PART
from renderers.transport.penumbra.pyramid import PIECE, Pyramid, pyramids_around
from renderers.transport.threads import chunks

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Filter = Literal["bilinear", "nearest"]
GOLDEN = (5**0.5 - 1) / 2


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
        if len(self.maps) == 1:
            return self.maps[0].hidden(p, filter, n, offset)
        out = np.full(len(p), -1, np.float32)
        for shadow, (rows, _) in zip(self.maps, by_face(self.emitter, [m.pyramid for m in self.maps], p), strict=True):
            out[rows] = shadow.hidden(p[rows], filter, None if n is None else n[rows], offset)
        return out


@dataclass(frozen=True, eq=False)
class CombinedShadows:
    """What stands still and what moves, each with maps of its own: only the second, small, is built anew for every frame.

    The truth lies between max(V_s, V_d) and min(1, V_s + V_d): V = 1 - (1 - V_s)(1 - V_d) takes both as independent parts of the
    light.
    """

    still: LightShadows
    moving: LightShadows

    def hidden(self, points: ArrayLike, normals: ArrayLike | None = None, offset: float = 0.0, filter: Filter = "bilinear") -> F32:
        """As `LightShadows.hidden`; -1 where either does not reach."""
        v, w = (one.hidden(points, normals, offset, filter) for one in (self.still, self.moving))
        return np.where((v < 0) | (w < 0), np.float32(-1), 1 - (1 - v) * (1 - w))


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
    used = np.zeros(len(world.positions), bool)
    for piece in chunks(len(others), PIECE):
        used[world.triangles[piece][others[piece]]] = True
    geometry = world.positions[used]
    if not len(geometry):
        return []
    return pyramids_around(
        emitter.centre, emitter.frame, points, geometry, resolution, near * emitter.size, one_sided=emitter.one_sided
    )


def casters_of(world: World, emitter: Emitter, casters: NDArray[np.bool_] | None = None) -> F64:
    """Corners (T, 3, 3) of the triangles that cast shadows of `emitter`: all but its own, or those of `casters` (T,)."""
    return world.positions[world.triangles[_casting(world, emitter, casters)]].astype(np.float64)


def _casting(world: World, emitter: Emitter, casters: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    cast = np.ones(len(world.triangles), bool) if casters is None else casters.copy()
    cast[emitter.triangles] = False
    return cast


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
    opacity: F64 | None = None,
    counters: Counter[str] | None = None,
) -> LightShadows:
    """Build the maps of `emitter` from light points (N, 3).

    resolution: pixels across 90° of a pyramid. map_resolution: texels across a shadow map, at least (their pitch fits the pixels).
    near: distance of the near plane from the light, in half sizes of the light. casters: bool (T,), which triangles cast (all but
    the emitter's own by default); the others receive. opacity: float (T,) in [0, 1], all 1 by default: an instance of opacity α
    casts in a share α of the maps, so that its full shadow is α.
    """
    pyramids = pyramids_of(world, emitter, points, resolution, near)
    cast = _casting(world, emitter, casters)
    corners = world.positions[world.triangles[cast]]
    cover = np.ones((len(corners), 2))
    if opacity is not None:
        cover[:, 0] = opacity[cast]
    # instances on top of one another miss different maps
    cover[:, 1] = world.instance[cast] * GOLDEN % 1
    return LightShadows(emitter, tuple(_one(p, corners, cover, points, map_resolution, how, slope, counters) for p in pyramids))


def _one(
    pyramid: Pyramid, corners: NDArray[np.floating], cover: F64, points: F64, resolution: int, how: Construction, slope: Slope,
    counters: Counter[str] | None,
) -> PenumbraMap:  # fmt: skip
    texels = HALF_TEXELS[how.walk]
    pixels = pyramid.pitch * (1.0 if slope.filter == "bilinear" else 0.5)
    local = pyramid.local(points)
    fitting = aligned_cameras(pyramid, local, resolution) if how.walk == "exact" else None
    if fitting is None:
        make = map_maker(pyramid, corners, (resolution, resolution), texels, pixels, slope.limit, cover)
        return assemble(pyramid, cameras_of(pyramid, local, resolution), make, how, counters)
    cameras, grid = fitting
    make = map_maker(pyramid, corners, grid.shape, texels, pixels, slope.limit, cover)
    return assemble(pyramid, cameras, make, how, counters, grid)


def map_maker(
    pyramid: Pyramid, corners: NDArray[np.floating], shape: tuple[int, int], texels: float = 0.0, pixels: float = 0.0,
    limit: float = 0.0, cover: F64 | None = None,
) -> MapMaker:  # fmt: skip
    """Draws shadow maps of World triangles (T, 3, 3) for cameras; the rest as in `depth_maps`, opaque by default."""
    local, kept = _before(pyramid, corners, cover)

    def draw(cameras: F64, top: NDArray[np.int64], out: F32) -> None:
        spare = np.empty((2, *out.shape), np.float32)
        depth_maps(local, kept, np.ascontiguousarray(cameras), top, out, spare, texels, pixels, limit)

    return MapMaker(shape, draw, local.nbytes + corners.nbytes + 2 * kept.nbytes)


def _before(pyramid: Pyramid, corners: NDArray[np.floating], cover: F64 | None) -> tuple[F64, F64]:
    """Triangles with a corner before the apex, in the pyramid's frame, and their cover; in pieces, so that little else exists."""
    pieces = chunks(len(corners), PIECE)
    ahead = [(pyramid.local(corners[piece])[:, :, 2] > 0).any(axis=1) for piece in pieces]
    local = np.empty((sum(int(a.sum()) for a in ahead), 3, 3))
    kept = np.tile([1.0, 0.0], (len(local), 1))
    first = 0
    for piece, keep in zip(pieces, ahead, strict=True):
        last = first + int(keep.sum())
        local[first:last] = pyramid.local(corners[piece])[keep]
        if cover is not None:
            kept[first:last] = cover[piece][keep]
        first = last
    return local, kept


def drawn(maps: MapMaker, cameras: F64) -> F32:
    """Whole shadow maps float32 (N, h, w) of cameras (N, CAMERA)."""
    out = np.empty((len(cameras), *maps.shape), np.float32)
    for part in chunks(len(cameras), PART):
        maps.draw(cameras[part], np.zeros(len(cameras[part]), np.int64), out[part])
    return out


@cache
def warm_up() -> None:
    """Compile (or load from numba's cache) all kernels on a map of a few pixels; once a process."""
    pyramid = Pyramid(np.zeros(3), np.eye(3), (-1.0, -1.0), 1.0, 2, 2, 1.0, 2.0)
    triangle = np.array([[[-9.0, -9, 1.5], [9, -9, 1.5], [0, 9, 1.5]]])
    for walk in ("exact", "midpoint"):
        _one(pyramid, triangle, np.array([[1.0, 0.0]]), np.zeros((1, 3)), 4, Construction(walk=walk), Slope(), None).hidden(
            np.ones((1, 3))
        )
