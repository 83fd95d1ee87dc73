"""Splatting: each record is added to all pixels inside its zone, whatever the order in which records were made.

    E(p) = Σ_k w_k max(0, E_k + (n_k × n)·∇_rE_k + (p - p_k)·∇_tE_k) / Σ_k w_k                    Gautron 2006, section 4.3

`gather` computes the same sums by looking from every point at all records. GL twin: `renderers.gl.caching`.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.transport.caching.records import Float, Records
from renderers.transport.caching.splat_kernels import accept, gather_records, splat_records
from renderers.transport.caching.weights import WEIGHTS, Weight, checked_accuracy
from renderers.transport.tiles import Tiles, tiles_of


class Canvas:
    """Pixels to which records are added. `rows` int (P,): flat indices of the pixels, in an image `width` wide.

    position, normal (P, 3): World, unit normals turned to the viewer. Everything is computed in `dtype`. sums (P, 4): Σ w E' and
    Σ w so far. few (P,): a record that would be the first to reach fewer pixels isn't worth its price, 0 everywhere at first; left
    (P,): those that were passed over for it (`thinned`).
    """

    def __init__(self, rows: NDArray[np.intp], width: int, position: Float, normal: Float, dtype: Any = np.float32) -> None:
        self.rows, self.width, self.dtype = rows, width, np.dtype(dtype)
        self.few, self.left = np.zeros(len(rows)), np.zeros(len(rows), bool)
        self.position, self.normal = (np.ascontiguousarray(a, dtype) for a in (position, normal))
        self.sums = np.zeros((len(rows), 4), dtype)
        single = (np.ascontiguousarray(a, np.float32) for a in (position, normal))
        self._tiles = tiles_of(rows, width, *single)

    @staticmethod
    def of(gbuffer: GBuffer, wanted: NDArray[np.bool_] | None = None, dtype: Any = np.float32) -> Canvas:
        """Canvas over the covered pixels of a G-buffer, or over those of them that are `wanted` (H, W)."""
        rows = np.flatnonzero(gbuffer.covered if wanted is None else gbuffer.covered & wanted)
        position, normal = gbuffer.position.reshape(-1, 3)[rows], gbuffer.normal.reshape(-1, 3)[rows]
        return Canvas(rows, gbuffer.size[0], position, normal, dtype)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def tiles(self) -> Tiles:
        """The pixels in screen tiles."""
        return self._tiles

    def clear(self) -> None:
        """Forget all records."""
        self.sums[:] = 0

    def add(
        self, records: Records, a: float, weight: Weight = "ward", gradients: bool = True, counters: Counter[str] | None = None
    ) -> None:
        """Splat records at accuracy a in (0, √2). counters: `splat_tests` and `splats` (pairs of record and pixel) are added to."""
        work = np.zeros((len(self._tiles.first) - 1, 2), np.int64)
        accuracy = self.dtype.type(checked_accuracy(a))
        columns = records.columns(self.dtype)
        splat_records(self.position, self.normal, self._tiles, columns, accuracy, WEIGHTS[weight], gradients, self.sums, work)
        if counters is not None:
            counters["splat_tests"] += int(work[:, 0].sum())
            counters["splats"] += int(work[:, 1].sum())

    def thinned(
        self, candidates: NDArray[np.int64], radius: Float, a: float, weight: Weight, covered: NDArray[np.bool_], limit: int
    ) -> NDArray[np.int64]:
        """Candidates (indices into the pixels) that no earlier one's zone covers, `limit` at most; `covered` (P,) is updated.

        Those whose zones cover fewer new pixels than `few` aren't taken: these pixels are `left`.
        """
        accepted = np.empty(min(len(candidates), limit), np.int64)
        reach = radius.astype(self.dtype)
        zones = reach, self.dtype.type(a), WEIGHTS[weight]
        count = accept(self.position, self.normal, self._tiles, candidates, *zones, covered, accepted, self.few, self.left)
        return accepted[:count]

    @property
    def missed(self) -> NDArray[np.bool_]:
        """Pixels that need a record, bool (P,): without a single one, and not left. Σ w < 1/a says the same as Σ w = 0: each
        contributing weight is at least 1/a."""
        return np.asarray((self.sums[:, 3] <= 0) & ~self.left)

    @property
    def alone(self) -> NDArray[np.intp]:
        """Flat indices of the pixels that were left and are reached by no record."""
        return self.rows[self.left & (self.sums[:, 3] <= 0)]

    @property
    def irradiance(self) -> Float:
        """Interpolated irradiance (P, 3); 0 where no record reaches."""
        weight = self.sums[:, 3:]
        return np.asarray(np.where(weight > 0, self.sums[:, :3] / np.where(weight > 0, weight, 1), 0))


def gather(
    position: Float, normal: Float, records: Records, a: float, weight: Weight = "ward", gradients: bool = True
) -> tuple[Float, Float]:
    """Interpolated irradiance (P, 3) at points with unit normals (P, 3), and the sum of weights (P,), by trying all records."""
    dtype = position.dtype.type
    sums = np.zeros((len(position), 4), dtype)
    gather_records(
        position, normal, records.columns(dtype), dtype(checked_accuracy(a)), WEIGHTS[weight], gradients, sums
    )  # fmt: skip
    total = sums[:, 3]
    return np.where(total[:, None] > 0, sums[:, :3] / np.where(total > 0, total, 1)[:, None], 0), total


@cache
def warm_up() -> None:
    """Compile (or load from numba's cache) the float32 kernels; once a process."""
    point = np.zeros((1, 3), np.float32)
    canvas = Canvas(np.zeros(1, np.intp), 1, point, point)
    canvas.add(Records.empty(np.float32), 0.1)
    canvas.thinned(np.zeros(0, np.int64), np.zeros(0), 0.1, "ward", np.zeros(1, bool), 1)
