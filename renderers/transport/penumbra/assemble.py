"""Events of all shadow maps, summed up to one attenuation function per pixel, under a memory bound (`plan`).

Where the bound allows it, all shadow maps are drawn once, and each tile of rows is finished at once. Otherwise, slab after slab of
rows, the bands of the maps that its rays cross (St-Amour 2004, algorithm 3.2, draws whole maps anew for every slab), all of them or
in batches. Tiles of rows are independent and taken by the first free thread; result and bytes depend on neither slabs, batches,
threads nor the order of light points.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.cameras import DU, DV
from renderers.transport.penumbra.compress import NONE, PERPENDICULAR, VERTICAL
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import Grid
from renderers.transport.penumbra.plan import plan_of
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.reduce import compress_row
from renderers.transport.penumbra.room import VERTEX, Functions
from renderers.transport.penumbra.work import Work
from renderers.transport.threads import in_threads

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
METRICS = {"none": NONE, "vertical": VERTICAL, "perpendicular": PERPENDICULAR}
# texels to each side of its centre that a stored depth stands for
HALF_TEXELS = {"exact": 0.5, "midpoint": 1.5}
# vertices a pixel that finished functions are taken to have when the bound is divided: what 2 % leaves of most scenes
EXPECTED = 7.0
# how much larger functions may become than those that are finished let expect
GROWTH = 1.1
# bytes of what is not worth counting one by one: threads, lines of state, one function's steps
SMALL = 1 << 20
MIB = 2.0**20


class MemoryBoundError(ValueError):
    """A memory bound that construction can't keep."""

    def __init__(self, bound: int, needed: int, pyramid: Pyramid, maps: int) -> None:
        what = f"penumbra deep shadow map of {pyramid.width}x{pyramid.height} pixels from {maps} shadow maps"
        super().__init__(
            f"memory: {bound / MIB:.0f} MiB are too few for a {what}; at least {math.ceil(needed / MIB)} MiB are needed"
        )


class MapMaker(NamedTuple):
    """Shadow maps on demand. shape: rows and columns of a map. draw(cameras, top, out, spare): fills out float32 (N, h, w) with the
    rows top … top + h - 1 of each map, spare (2, N, h, w) is room to work in. bytes: of what it holds.
    """

    shape: tuple[int, int]
    draw: Callable[[F64, I64, F32, F32], None]
    bytes: int = 0


@dataclass(frozen=True)
class Construction:
    """How functions are built from shadow maps. bias: added to every stored depth, World units. walk: exact, or the published
    midpoint.

    merge: events closer than this change V at once; None: 2⁻¹⁴ of the depth range (St-Amour 2004 §3.1, the interval is not
    published). compression with its tolerance epsilon; kappa: scale of the perpendicular metric's depth axis, its range is [0,
    kappa]; None: such that no vertex moves by more than half of `bias`, at least 1. budget: vertices that no function may exceed,
    0: any number; a pixel over it gets the least tolerance of its own that fits. memory: bound in bytes on what lives at once.
    """

    bias: float = 0.0
    walk: Literal["exact", "midpoint"] = "exact"
    merge: float | None = None
    compression: Literal["none", "vertical", "perpendicular"] = "vertical"
    epsilon: float = 0.02
    kappa: float | None = None
    budget: int = 0
    memory: int = 1 << 30

    @property
    def metric(self) -> int:
        """The compression as `compress` wants it."""
        return METRICS[self.compression]

    def scale(self, pyramid: Pyramid) -> float:
        """The perpendicular metric's unit of depth."""
        span = pyramid.far - pyramid.near
        if self.kappa is not None:
            return self.kappa / span
        return (max(1.0, 2 * self.epsilon * span / self.bias) if self.bias > 0 else 100.0) / span

    def interval(self, pyramid: Pyramid) -> float:
        """Depths within which events change V at once."""
        return (pyramid.far - pyramid.near) / 2**14 if self.merge is None else self.merge


def assemble(
    pyramid: Pyramid,
    cameras: F64,
    maps: MapMaker,
    how: Construction,
    counters: Counter[str] | None = None,
    grid: Grid | None = None,
    held: int = 0,
) -> PenumbraMap:
    """The penumbra deep shadow map of `cameras` (N, CAMERA) and their maps.

    grid: where the cameras come from `aligned_cameras`, its second result; the exact walk is then that of `lockstep`, with the same
    events. held: bytes of the memory bound that are taken already. counters: adds `shadow_maps`, `rays_walked`, `texels_walked`,
    `events` and `vertices`. Raises ValueError without cameras, MemoryBoundError where `how.memory` is too small.
    """
    if not len(cameras):
        raise ValueError("a penumbra deep shadow map needs at least one light point")
    tally = Counter[str]() if counters is None else counters
    width, pixels = pyramid.width, pyramid.width * pyramid.height
    aligned = grid if how.walk == "exact" else None
    beside = held + maps.bytes + cameras.nbytes + 8 * (pixels + 1) + SMALL
    done = Functions(pixels, min(EXPECTED, max(how.memory - beside, 0) / 2 / VERTEX / pixels))
    while done.pixels < pixels:
        rows = range(done.pixels // width, pyramid.height)
        # functions that turn out larger than expected leave less for the rest
        size = max(done.bytes, int(GROWTH * VERTEX * done.vertices / max(done.pixels, 1) * pixels))
        plan = plan_of(pyramid, rows, cameras, maps.shape, how.memory - beside - size, blocks=aligned is None)
        if (needed := plan.bytes + beside + size) > how.memory:
            raise MemoryBoundError(how.memory, needed, pyramid, len(cameras))
        done.limit = how.memory - beside - plan.bytes
        work = Work(pyramid, cameras, maps, how, aligned, plan, done, tally)
        for slab in plan.slabs:
            if not done.over:
                work.build(slab)
        del work
    tally["rays_walked"] += pixels * len(cameras)
    tally["events"] += done.events
    tally["texels_walked"] += done.steps
    tally["vertices"] += done.vertices
    texel = HALF_TEXELS[how.walk] * float(cameras[:, [DU, DV]].max())
    return PenumbraMap(pyramid, len(cameras), texel, *done.finished())


def recompressed(made: PenumbraMap, how: Construction) -> PenumbraMap:
    """An uncompressed map with the compression and budget of `how`, as if it had been built with them."""
    width = made.pyramid.width
    rows = [range(k * width, (k + 1) * width) for k in range(made.pyramid.height)]
    scale = how.scale(made.pyramid)

    def one(row: range) -> tuple[NDArray[np.int64], F32, F32]:
        start = made.start[row.start : row.stop + 1]
        return compress_row(start, made.depth, made.value, how.metric, how.epsilon, scale, how.budget)  # type: ignore[no-any-return]

    counts, depth, value = (np.concatenate(column) for column in zip(*in_threads(one, rows), strict=True))
    start = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    return PenumbraMap(made.pyramid, made.samples, made.texel, start, depth, value)
