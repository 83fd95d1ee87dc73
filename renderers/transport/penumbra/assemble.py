"""Events of all shadow maps, summed up to one attenuation function per pixel, in slabs of rows under a memory bound.

Within a pixel events are sorted by depth; all that lie within `merge` of the first of a group change V at once, at the last depth
of the group (an exit and an entry at one depth never leave [0, 1] in between). V is the running sum over N.

Where the maps of all light points fit the bound, they are made once and every tile is finished at once: only few rows' events
exist. Otherwise the maps are made anew for every slab (St-Amour 2004, algorithm 3.2), in batches. Tiles of rows are independent and
taken by the first free thread; result and bytes depend on neither slabs, batches, threads nor the order of light points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.cameras import DU, DV
from renderers.transport.penumbra.compress import NONE, PERPENDICULAR, VERTICAL, compress, fitted
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import Grid, interleaved, tile_events
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.walk import row_events
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
    batch = max(int(how.memory // 2 // make_maps(cameras[:1]).nbytes), 1)
    finished = []
    if len(cameras) <= batch:
        maps = walk.maps(cameras)
        tally["shadow_maps"] += len(cameras)

        def whole(rows: range) -> _Tile:
            return _reduced(pyramid, rows, [walk.events(cameras, maps, rows)], len(cameras), how)

        finished = in_threads(whole, _tiles(range(pyramid.height)))
    else:
        for slab in _slabs(pyramid, len(cameras), how.memory):
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


@dataclass(frozen=True)
class _Walk:
    """Shadow maps as one of the walks wants them, and the events that it finds in them."""

    pyramid: Pyramid
    make_maps: MapMaker
    how: Construction
    grid: Grid | None

    def maps(self, cameras: F64) -> F32:
        """Shadow maps of `cameras`; a few at a time are rearranged, so that they never exist twice."""
        if self.grid is None or self.grid.fine == 1:
            return self.make_maps(cameras)
        parts = chunks(len(cameras), REARRANGED)
        h, w = self.grid.shape
        out = np.empty((len(cameras), h, self.grid.fine, w // self.grid.fine), np.float32)
        for part in parts:
            out[part] = interleaved(self.make_maps(cameras[part]), self.grid)
        return out

    def events(self, cameras: F64, maps: F32, rows: range) -> _Events:
        """Events of some rows of the pyramid in these maps."""
        p, bias = self.pyramid, self.how.bias
        vs = p.vs[rows.start : rows.stop]
        if self.grid is not None:
            four = maps if maps.ndim == 4 else maps[:, :, None]
            return _Events(*tile_events(four, cameras, p.us, vs, p.near, p.far, bias, self.grid.coarse))
        exact = self.how.walk == "exact"
        found = [_Events(*row_events(maps, cameras, p.us, float(v), p.near, p.far, bias, exact)) for v in vs]
        pixel = np.concatenate([one.pixel + row * p.width for row, one in enumerate(found)]).astype(np.int32)
        z, sign = np.concatenate([one.z for one in found]), np.concatenate([one.sign for one in found])
        return _Events(pixel, z, sign, sum(one.steps for one in found))


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
    """Ranges of rows whose events fit half of the bound at four events per ray, which is several times what scenes need."""
    per_row = 4 * EVENT_BYTES * pyramid.width * cameras
    size = max(int(memory // 2 // per_row), 1)
    return [range(s.start, s.stop) for s in chunks(pyramid.height, size)]


def _reduced(pyramid: Pyramid, rows: range, parts: list[_Events], cameras: int, how: Construction) -> _Tile:
    """Vertices per pixel, depths and values of some rows, and how many events and steps went in."""
    pixel, z, sign = (np.concatenate(column) if len(column) > 1 else column[0] for column in list(zip(*parts, strict=True))[:3])
    span = pyramid.far - pyramid.near
    merge = span / 2**14 if how.merge is None else how.merge
    kappa = how.kappa
    if kappa is None:
        kappa = max(1.0, 2 * how.epsilon * span / how.bias) if how.bias > 0 else 100.0
    counts, depth, value = reduce_tile(
        pyramid.width * len(rows), pixel, z, sign, cameras, merge, METHODS[how.compression], how.epsilon, kappa / span, how.budget
    )
    return _Tile(counts, depth, value, len(z), sum(part.steps for part in parts))


@numba.njit(nogil=True, cache=True)
def reduce_tile(pixels, pixel, z, sign, samples, merge, method, epsilon, scale, budget):  # type: ignore[no-untyped-def]
    """Events (E,) of some pixels, in any order, to packed functions: counts int64 (pixels,), depth, value float32 (M,).

    An event is sorted as one integer: the bits of a positive float rise with it, and its sign fills the freed bit.
    """
    start = np.zeros(pixels + 1, np.int64)
    for p in pixel:
        start[p + 1] += 1
    longest = start.max() if len(pixel) else 0
    start = np.cumsum(start)
    place = start[:-1].copy()
    bits, keys = z.view(np.uint32), np.empty(len(z), np.uint32)
    for k in range(len(z)):
        keys[place[pixel[k]]] = (bits[k] << np.uint32(1)) | np.uint32(sign[k] > 0)
        place[pixel[k]] += 1
    counts = np.zeros(pixels, np.int64)
    depth, value = np.empty(2 * len(z) + 2, np.float32), np.empty(2 * len(z) + 2, np.float32)
    step_z, step_v = np.empty(2 * longest + 2), np.empty(2 * longest + 2)
    out_z, out_v = np.empty(2 * longest + 4), np.empty(2 * longest + 4)
    total = 0
    for p in range(pixels):
        own = keys[start[p] : start[p + 1]]
        own.sort()
        n = accumulate(own, samples, merge, step_z, step_v)
        m = compress(step_z, step_v, n, method, epsilon, scale, out_z, out_v)
        if budget > 0 and m > budget:
            m = fitted(step_z, step_v, n, method, epsilon, scale, budget, out_z, out_v)
        for k in range(m):
            depth[total + k], value[total + k] = out_z[k], out_v[k]
        counts[p] = m
        total += m
    return counts, depth[:total].copy(), value[:total].copy()


@numba.njit(nogil=True, cache=True)
def accumulate(keys, samples, merge, step_z, step_v):  # type: ignore[no-untyped-def]
    """Step form of one pixel's sorted events: fills step_z, step_v (two points a change), returns the number of points."""
    depths = (keys >> np.uint32(1)).view(np.float32)
    n, inside, k = 0, 0, 0
    while k < len(keys):
        first, before = depths[k], inside
        last = first
        while k < len(keys) and depths[k] - first <= merge:
            last = depths[k]
            inside += 1 if keys[k] & np.uint32(1) else -1
            k += 1
        if inside != before:
            step_z[n], step_v[n] = last, before / samples
            step_z[n + 1], step_v[n + 1] = last, inside / samples
            n += 2
    return n
