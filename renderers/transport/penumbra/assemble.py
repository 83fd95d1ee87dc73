"""Events of all shadow maps, summed up to one attenuation function per pixel, in slabs of rows under a memory bound.

Where the maps of all light points fit half of the bound, they are made once and every tile is finished at once: only few rows'
events exist. Otherwise the maps are made anew for every slab (St-Amour 2004, algorithm 3.2), in batches; a quarter is for maps, a
quarter for events, the rest for what both need on the way. Tiles of rows are independent and taken by the first free thread; result
and bytes depend on neither slabs, batches, threads nor the order of light points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.cameras import DU, DV
from renderers.transport.penumbra.compress import NONE, PERPENDICULAR, VERTICAL
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import Grid, interleaved, tile_events
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.reduce import compress_row, reduce_tile
from renderers.transport.penumbra.walk import bounds_of, row_events
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
MapMaker = Callable[[F64], F32]
METHODS = {"none": NONE, "vertical": VERTICAL, "perpendicular": PERPENDICULAR}
# texels to each side of its centre that a stored depth stands for
HALF_TEXELS = {"exact": 0.5, "midpoint": 1.5}
EVENT_BYTES = 9
TILE = 8
REARRANGED = 16


@dataclass(frozen=True)
class Construction:
    """How functions are built from shadow maps. bias: added to every stored depth, World units. walk: exact, or the published
    midpoint.

    merge: events closer than this change V at once; None: 2⁻¹⁴ of the depth range (St-Amour 2004 §3.1, the interval is not
    published). compression with its tolerance epsilon; kappa: scale of the perpendicular metric's depth axis, its range is [0,
    kappa]; None: such that no vertex moves by more than half of `bias`, at least 1. budget: vertices that no function may exceed,
    0: any number; a pixel over it gets the least tolerance of its own that fits. memory: bound in bytes on maps and events that
    live at once.
    """

    bias: float = 0.0
    walk: Literal["exact", "midpoint"] = "exact"
    merge: float | None = None
    compression: Literal["none", "vertical", "perpendicular"] = "vertical"
    epsilon: float = 0.02
    kappa: float | None = None
    budget: int = 0
    memory: int = 1 << 30


class _Events(NamedTuple):
    pixel: NDArray[np.int32]
    z: F32
    sign: NDArray[np.int8]
    steps: int


class _Maps(NamedTuple):
    """Depths (N, h, w) with the bounds of their blocks; or rearranged for the lockstep, without."""

    depth: F32
    low: F32 | None = None
    high: F32 | None = None


class _Tile(NamedTuple):
    counts: NDArray[np.int64]
    depth: F32
    value: F32
    events: int
    steps: int


def assemble(
    pyramid: Pyramid,
    cameras: F64,
    make_maps: MapMaker,
    how: Construction,
    counters: Counter[str] | None = None,
    grid: Grid | None = None,
) -> PenumbraMap:
    """The penumbra deep shadow map of `cameras` (N, CAMERA); make_maps(cameras[a:b]) returns their depths, float32 (b - a, h, w).

    grid: where the cameras come from `aligned_cameras`, its second result; the exact walk is then that of `lockstep`, with the same
    events. counters: adds `shadow_maps`, `rays_walked`, `texels_walked`, `events` and `vertices`. Raises ValueError without
    cameras.
    """
    if not len(cameras):
        raise ValueError("a penumbra deep shadow map needs at least one light point")
    tally = Counter[str]() if counters is None else counters
    walk = _Walk(pyramid, make_maps, how, grid if how.walk == "exact" else None)
    size = make_maps(cameras[:1]).nbytes
    if len(cameras) * size <= how.memory // 2:
        finished = _at_once(walk, cameras, tally)
    else:
        finished = []
        batch = max(int(how.memory // 4 // size), 1)
        for slab in _slabs(pyramid, len(cameras), how.memory // 4):
            finished += _slab(walk, cameras, slab, batch, tally)
    tally["rays_walked"] += pyramid.width * pyramid.height * len(cameras)
    counts = np.concatenate([tile.counts for tile in finished])
    packed = PenumbraMap(
        pyramid,
        len(cameras),
        HALF_TEXELS[how.walk] * float(cameras[:, [DU, DV]].max()),
        np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
        np.concatenate([tile.depth for tile in finished]),
        np.concatenate([tile.value for tile in finished]),
    )
    tally["events"] += sum(tile.events for tile in finished)
    tally["texels_walked"] += sum(tile.steps for tile in finished)
    tally["vertices"] += len(packed.depth)
    return packed


def recompressed(made: PenumbraMap, how: Construction) -> PenumbraMap:
    """An uncompressed map with the compression and budget of `how`, as if it had been built with them."""
    width = made.pyramid.width
    rows = [range(k * width, (k + 1) * width) for k in range(made.pyramid.height)]
    scale = _kappa(made.pyramid, how) / (made.pyramid.far - made.pyramid.near)
    method = METHODS[how.compression]

    def one(row: range) -> tuple[NDArray[np.int64], F32, F32]:
        start = made.start[row.start : row.stop + 1]
        return compress_row(start, made.depth, made.value, method, how.epsilon, scale, how.budget)  # type: ignore[no-any-return]

    counts, depth, value = (np.concatenate(column) for column in zip(*in_threads(one, rows), strict=True))
    start = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    return PenumbraMap(made.pyramid, made.samples, made.texel, start, depth, value)


@dataclass(frozen=True)
class _Walk:
    """Shadow maps as one of the walks wants them, and the events that it finds in them."""

    pyramid: Pyramid
    make_maps: MapMaker
    how: Construction
    grid: Grid | None

    def maps(self, cameras: F64) -> _Maps:
        """Shadow maps of `cameras`; a few at a time are rearranged, so that they never exist twice."""
        if self.grid is None:
            made = self.make_maps(cameras)
            return _Maps(made, *bounds_of(made))
        if self.grid.fine == 1:
            return _Maps(self.make_maps(cameras)[:, :, None])
        parts = chunks(len(cameras), REARRANGED)
        h, w = self.grid.shape
        out = np.empty((len(cameras), h, self.grid.fine, w // self.grid.fine), np.float32)
        for part in parts:
            out[part] = interleaved(self.make_maps(cameras[part]), self.grid)
        return _Maps(out)

    def events(self, cameras: F64, maps: _Maps, rows: range) -> _Events:
        """Events of some rows of the pyramid in these maps."""
        p, bias = self.pyramid, self.how.bias
        vs = p.vs[rows.start : rows.stop]
        if self.grid is not None:
            return _Events(*tile_events(maps.depth, cameras, p.us, vs, p.near, p.far, bias, self.grid.coarse))
        exact = self.how.walk == "exact"
        found = [_Events(*row_events(*maps, cameras, p.us, float(v), p.near, p.far, bias, exact)) for v in vs]
        pixel = np.concatenate([one.pixel + row * p.width for row, one in enumerate(found)]).astype(np.int32)
        z, sign = np.concatenate([one.z for one in found]), np.concatenate([one.sign for one in found])
        return _Events(pixel, z, sign, sum(one.steps for one in found))


def _at_once(walk: _Walk, cameras: F64, tally: Counter[str]) -> list[_Tile]:
    """All tiles from one set of shadow maps."""
    maps = walk.maps(cameras)
    tally["shadow_maps"] += len(cameras)

    def whole(rows: range) -> _Tile:
        return _reduced(walk.pyramid, rows, [walk.events(cameras, maps, rows)], len(cameras), walk.how)

    return in_threads(whole, _tiles(range(walk.pyramid.height)))


def _slab(walk: _Walk, cameras: F64, slab: range, batch: int, tally: Counter[str]) -> list[_Tile]:
    """Finished tiles of one slab, its shadow maps made in batches."""
    tiles = _tiles(slab)
    held: list[list[_Events]] = [[] for _ in tiles]
    for part in chunks(len(cameras), batch):
        here = cameras[part]
        maps = walk.maps(here)
        tally["shadow_maps"] += len(here)
        for kept, found in zip(held, in_threads(partial(walk.events, here, maps), tiles), strict=True):
            kept.append(found)
    return in_threads(
        lambda one: _reduced(walk.pyramid, one[0], one[1], len(cameras), walk.how), list(zip(tiles, held, strict=True))
    )


def _tiles(rows: range) -> list[range]:
    """A few rows at a time: they read almost the same texels."""
    return [range(rows[part][0], rows[part][-1] + 1) for part in chunks(len(rows), TILE)]


def _slabs(pyramid: Pyramid, cameras: int, memory: int) -> list[range]:
    """Ranges of rows whose events fit this many bytes at four events per ray, which is several times what scenes need."""
    per_row = 4 * EVENT_BYTES * pyramid.width * cameras
    size = max(int(memory // per_row), 1)
    return [range(s.start, s.stop) for s in chunks(pyramid.height, size)]


def _reduced(pyramid: Pyramid, rows: range, parts: list[_Events], cameras: int, how: Construction) -> _Tile:
    """Vertices per pixel, depths and values of some rows, and how many events and steps went in."""
    pixel, z, sign = (np.concatenate(column) if len(column) > 1 else column[0] for column in list(zip(*parts, strict=True))[:3])
    span = pyramid.far - pyramid.near
    merge = span / 2**14 if how.merge is None else how.merge
    kappa = _kappa(pyramid, how)
    counts, depth, value = reduce_tile(
        pyramid.width * len(rows), pixel, z, sign, cameras, merge, METHODS[how.compression], how.epsilon, kappa / span, how.budget
    )
    return _Tile(counts, depth, value, len(z), sum(part.steps for part in parts))


def _kappa(pyramid: Pyramid, how: Construction) -> float:
    if how.kappa is not None:
        return how.kappa
    return max(1.0, 2 * how.epsilon * (pyramid.far - pyramid.near) / how.bias) if how.bias > 0 else 100.0
