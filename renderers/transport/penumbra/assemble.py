"""Events of all shadow maps, summed up to one attenuation function per pixel, in slabs of rows under a memory bound.

Within a pixel events are sorted by depth; all that lie within `merge` of the first of a group change V at once, at the last depth
of the group (an exit and an entry at one depth never leave [0, 1] in between). V is the running sum over N.

Where the maps of all light points fit the bound, they are made once and every row is finished at once: only one row's events exist.
Otherwise the maps are made anew for every slab (St-Amour 2004, algorithm 3.2), in batches. Rows are independent and taken by the
first free thread; result and bytes depend on neither slabs, batches, threads nor the order of light points.
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

from renderers.transport.penumbra.compress import NONE, PERPENDICULAR, VERTICAL, compress
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.walk import row_events
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
MapMaker = Callable[[F64], F32]
METHODS = {"none": NONE, "vertical": VERTICAL, "perpendicular": PERPENDICULAR}
EVENT_BYTES = 9


@dataclass(frozen=True)
class Construction:
    """How functions are built from shadow maps. bias: added to every stored depth, World units. walk: exact, or the published
    midpoint.

    merge: events closer than this change V at once; None: 2⁻¹⁴ of the depth range (St-Amour 2004 §3.1, the interval is not
    published). compression with its tolerance epsilon; kappa: scale of the perpendicular metric's depth axis, its range is [0,
    kappa]; None: such that no vertex moves by more than half of `bias`, at least 1. memory: bound in bytes on maps and events that
    live at once.
    """

    bias: float = 0.0
    walk: Literal["exact", "midpoint"] = "exact"
    merge: float | None = None
    compression: Literal["none", "vertical", "perpendicular"] = "vertical"
    epsilon: float = 0.02
    kappa: float | None = None
    memory: int = 1 << 30


class _Events(NamedTuple):
    pixel: NDArray[np.int32]
    z: F32
    sign: NDArray[np.int8]
    steps: int


class _Row(NamedTuple):
    counts: NDArray[np.int64]
    depth: F32
    value: F32
    events: int
    steps: int


def assemble(
    pyramid: Pyramid, cameras: F64, make_maps: MapMaker, how: Construction, counters: Counter[str] | None = None
) -> PenumbraMap:
    """The penumbra deep shadow map of `cameras` (N, CAMERA); make_maps(cameras[a:b]) returns their depths, float32 (b - a, h, w).

    counters: adds `shadow_maps`, `rays_walked`, `texels_walked`, `events` and `vertices`. Raises ValueError without cameras.
    """
    if not len(cameras):
        raise ValueError("a penumbra deep shadow map needs at least one light point")
    tally = Counter[str]() if counters is None else counters
    first = make_maps(cameras[:1])
    batch = max(int(how.memory // 2 // first.nbytes), 1)
    finished = []
    if len(cameras) <= batch:
        maps = make_maps(cameras)
        tally["shadow_maps"] += len(cameras)

        def whole(row: int) -> _Row:
            return _reduced(pyramid, [_events(pyramid, cameras, maps, row, how)], len(cameras), how)

        finished = in_threads(whole, range(pyramid.height))
    else:
        for slab in _slabs(pyramid, len(cameras), how.memory):
            finished += _slab(pyramid, cameras, make_maps, slab, batch, how, tally)
    tally["rays_walked"] += pyramid.width * pyramid.height * len(cameras)
    counts = np.concatenate([row.counts for row in finished])
    packed = PenumbraMap(
        pyramid,
        len(cameras),
        np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
        np.concatenate([row.depth for row in finished]),
        np.concatenate([row.value for row in finished]),
    )
    tally["events"] += sum(row.events for row in finished)
    tally["texels_walked"] += sum(row.steps for row in finished)
    tally["vertices"] += len(packed.depth)
    return packed


def _slab(
    pyramid: Pyramid, cameras: F64, make_maps: MapMaker, slab: range, batch: int, how: Construction, tally: Counter[str]
) -> list[_Row]:
    """Finished rows of one slab, its shadow maps made in batches."""
    held: list[list[_Events]] = [[] for _ in slab]
    for part in chunks(len(cameras), batch):
        here = cameras[part]
        maps = make_maps(here)
        tally["shadow_maps"] += len(here)
        walk = partial(_events, pyramid, here, maps, how=how)
        for kept, found in zip(held, in_threads(walk, slab), strict=True):
            kept.append(found)
    return in_threads(lambda events: _reduced(pyramid, events, len(cameras), how), held)


def _slabs(pyramid: Pyramid, cameras: int, memory: int) -> list[range]:
    """Ranges of rows whose events fit half of the bound at four events per ray, which is several times what scenes need."""
    per_row = 4 * EVENT_BYTES * pyramid.width * cameras
    size = max(int(memory // 2 // per_row), 1)
    return [range(s.start, s.stop) for s in chunks(pyramid.height, size)]


def _events(pyramid: Pyramid, cameras: F64, maps: F32, row: int, how: Construction) -> _Events:
    v = float(pyramid.vs[row])
    found = row_events(maps, cameras, pyramid.us, v, pyramid.near, pyramid.far, how.bias, how.walk == "exact")
    return _Events(*found)


def _reduced(pyramid: Pyramid, parts: list[_Events], cameras: int, how: Construction) -> _Row:
    """Vertices per pixel, depths and values of one row, and how many events and steps went in."""
    pixel, z, sign = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:3])
    span = pyramid.far - pyramid.near
    merge = span / 2**14 if how.merge is None else how.merge
    kappa = how.kappa
    if kappa is None:
        kappa = max(1.0, 2 * how.epsilon * span / how.bias) if how.bias > 0 else 100.0
    counts, depth, value = reduce_row(
        pyramid.width, pixel, z, sign, cameras, merge, METHODS[how.compression], how.epsilon, kappa / span
    )
    return _Row(counts, depth, value, len(z), sum(part.steps for part in parts))


@numba.njit(nogil=True, cache=True)
def reduce_row(width, pixel, z, sign, samples, merge, method, epsilon, scale):  # type: ignore[no-untyped-def]
    """Events (E,) of a row, in any order, to packed functions: counts int64 (width,), depth, value float32 (M,)."""
    start = np.zeros(width + 1, np.int64)
    for p in pixel:
        start[p + 1] += 1
    start = np.cumsum(start)
    place = start[:-1].copy()
    sorted_z, sorted_sign = np.empty_like(z), np.empty_like(sign)
    for k in range(len(z)):
        sorted_z[place[pixel[k]]], sorted_sign[place[pixel[k]]] = z[k], sign[k]
        place[pixel[k]] += 1
    counts = np.zeros(width, np.int64)
    depth, value = np.empty(2 * len(z) + 2, np.float32), np.empty(2 * len(z) + 2, np.float32)
    total = 0
    for p in range(width):
        a, b = start[p], start[p + 1]
        step_z, step_v = np.empty(2 * (b - a) + 2), np.empty(2 * (b - a) + 2)
        out_z, out_v = np.empty(2 * (b - a) + 4), np.empty(2 * (b - a) + 4)
        n = accumulate(sorted_z[a:b], sorted_sign[a:b], samples, merge, step_z, step_v)
        m = compress(step_z, step_v, n, method, epsilon, scale, out_z, out_v)
        for k in range(m):
            depth[total + k], value[total + k] = out_z[k], out_v[k]
        counts[p] = m
        total += m
    return counts, depth[:total].copy(), value[:total].copy()


@numba.njit(nogil=True, cache=True)
def accumulate(z, sign, samples, merge, step_z, step_v):  # type: ignore[no-untyped-def]
    """Step form of one pixel's events: fills step_z, step_v (two points a change), returns the number of points."""
    order = np.argsort(z)
    n, inside, k = 0, 0, 0
    while k < len(order):
        first, before = z[order[k]], inside
        last = first
        while k < len(order) and z[order[k]] - first <= merge:
            last = z[order[k]]
            inside += sign[order[k]]
            k += 1
        if inside != before:
            step_z[n], step_v[n] = last, before / samples
            step_z[n + 1], step_v[n + 1] = last, inside / samples
            n += 2
    return n
