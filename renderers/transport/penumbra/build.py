"""Penumbra deep shadow maps of one emitter of a World: pyramids, shadow maps, functions; and their common lookup."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.world import World
from renderers.transport.penumbra.assemble import HALF_TEXELS, Construction, MapMaker, assemble
from renderers.transport.penumbra.cameras import cameras_of
from renderers.transport.penumbra.depth import SEEN, depth_maps
from renderers.transport.penumbra.emitters import Emitter
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import aligned_cameras
from renderers.transport.penumbra.plan import PART
from renderers.transport.penumbra.pyramid import PIECE, Pyramid, pyramids_around
from renderers.transport.threads import chunks, thread_count

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

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        return sum(m.nbytes for m in self.maps)


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


class Casters(NamedTuple):
    """What casts shadows: vertices (V, 3), World, triangles int32 (T, 3), cover float64 (T, 2): opacity and a shift of ranks."""

    vertices: NDArray[np.floating]
    triangles: NDArray[np.int32]
    cover: F64

    @property
    def bytes(self) -> int:
        """Size of all of it."""
        return self.vertices.nbytes + self.triangles.nbytes + self.cover.nbytes


def casters_of(world: World, emitter: Emitter, casters: NDArray[np.bool_] | None = None, opacity: F64 | None = None) -> Casters:
    """What casts shadows of `emitter`: all triangles but its own, or those of `casters` (T,), with the opacity (T,) of each."""
    cast = np.ones(len(world.triangles), bool) if casters is None else casters.copy()
    cast[emitter.triangles] = False
    vertices, triangles = welded(world.positions, world.triangles[cast])
    cover = np.ones((len(triangles), 2))
    if opacity is not None:
        cover[:, 0] = opacity[cast]
    # instances on top of one another miss different maps
    cover[:, 1] = world.instance[cast] * GOLDEN % 1
    return Casters(vertices, triangles, cover)


def welded(positions: F32, triangles: NDArray[np.integer]) -> tuple[F32, NDArray[np.int32]]:
    """Vertices (V, 3) that triangles (T, 3) use, in the order of their first use, each position once; and int32 (T, 3) of these."""
    used = np.zeros(len(positions), bool)
    used[triangles] = True
    vertices = positions[used]
    place = np.cumsum(used, dtype=np.int32) - 1
    x, y, z = np.ascontiguousarray(vertices).view(np.uint32).T
    both = x.astype(np.uint64) << np.uint64(32) | y
    order = np.lexsort((z, both)).astype(np.int32)
    new = np.ones(len(order), bool)
    new[1:] = (both[order[1:]] != both[order[:-1]]) | (z[order[1:]] != z[order[:-1]])
    # a sort that keeps its order puts the first of equal positions first
    first = order[new]
    rank = np.empty(len(first), np.int32)
    rank[np.argsort(first)] = np.arange(len(first), dtype=np.int32)
    joined = np.empty(len(order), np.int32)
    joined[order] = rank[np.cumsum(new, dtype=np.int32) - 1]
    first.sort()
    return vertices[first], joined[place[triangles]]


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
    held: int = 0,
) -> LightShadows:
    """Build the maps of `emitter` from light points (N, 3).

    resolution: pixels across 90° of a pyramid. map_resolution: texels across a shadow map, at least (their pitch fits the pixels).
    near: distance of the near plane from the light, in half sizes of the light. casters: bool (T,), which triangles cast (all but
    the emitter's own by default); the others receive. opacity: float (T,) in [0, 1], all 1 by default: an instance of opacity α
    casts in a share α of the maps, so that its full shadow is α. held: bytes of the memory bound that are taken already. Raises
    MemoryBoundError where the bound is too small.
    """
    pyramids = pyramids_of(world, emitter, points, resolution, near)
    cast = casters_of(world, emitter, casters, opacity)
    made: list[PenumbraMap] = []
    for pyramid in pyramids:
        taken = held + cast.bytes + sum(m.nbytes for m in made)
        made.append(_one(pyramid, cast, points, map_resolution, how, slope, counters, taken))
    return LightShadows(emitter, tuple(made))


def _one(
    pyramid: Pyramid, cast: Casters, points: F64, resolution: int, how: Construction, slope: Slope, counters: Counter[str] | None,
    held: int = 0,
) -> PenumbraMap:  # fmt: skip
    texels = HALF_TEXELS[how.walk]
    pixels = pyramid.pitch * (1.0 if slope.filter == "bilinear" else 0.5)
    local = pyramid.local(points)
    fitting = aligned_cameras(pyramid, local, resolution) if how.walk == "exact" else None
    if fitting is None:
        make = map_maker(pyramid, cast, (resolution, resolution), texels, pixels, slope.limit)
        return assemble(pyramid, cameras_of(pyramid, local, resolution), make, how, counters, held=held)
    cameras, grid = fitting
    make = map_maker(pyramid, cast, grid.shape, texels, pixels, slope.limit)
    return assemble(pyramid, cameras, make, how, counters, grid, held)


def map_maker(
    pyramid: Pyramid, cast: Casters, shape: tuple[int, int], texels: float = 0.0, pixels: float = 0.0, limit: float = 0.0
) -> MapMaker:
    """Draws shadow maps for cameras; the rest as in `depth_maps`."""
    local = np.empty((len(cast.vertices), 3))
    for piece in chunks(len(local), PIECE):
        local[piece] = pyramid.local(cast.vertices[piece])

    def draw(cameras: F64, top: NDArray[np.int64], out: F32, spare: F32) -> None:
        depth_maps(local, *cast[1:], np.ascontiguousarray(cameras), top, out, spare, texels, pixels, limit)

    return MapMaker(shape, draw, local.nbytes + thread_count() * len(local) * SEEN)


def drawn(maps: MapMaker, cameras: F64) -> F32:
    """Whole shadow maps float32 (N, h, w) of cameras (N, CAMERA)."""
    out = np.empty((len(cameras), *maps.shape), np.float32)
    for part in chunks(len(cameras), PART):
        spare = np.empty((2, *out[part].shape), np.float32)
        maps.draw(cameras[part], np.zeros(len(cameras[part]), np.int64), out[part], spare)
    return out


@cache
def warm_up() -> None:
    """Compile (or load from numba's cache) all kernels on a map of a few pixels; once a process."""
    pyramid = Pyramid(np.zeros(3), np.eye(3), (-1.0, -1.0), 1.0, 2, 2, 1.0, 2.0)
    vertices = np.array([[-9.0, -9, 1.5], [9, -9, 1.5], [0, 9, 1.5]], np.float32)
    cast = Casters(vertices, np.arange(3, dtype=np.int32)[None], np.array([[1.0, 0.0]]))
    for walk in ("exact", "midpoint"):
        _one(pyramid, cast, np.zeros((1, 3)), 4, Construction(walk=walk), Slope(), None).hidden(np.ones((1, 3)))
