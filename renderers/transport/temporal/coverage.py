"""How many pixels a record contributes to: what decides whether it is renewed. Twin of an occlusion query around its splat."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Records
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.splat_kernels import tiles_reached, weight_at
from renderers.transport.caching.weights import WEIGHTS, Weight, checked_accuracy


def coverage(canvas: Canvas, records: Records, a: float, weight: Weight = "ward") -> NDArray[np.int64]:
    """Pixels inside the zone of each record at accuracy a, (K,)."""
    counts = np.zeros(len(records), np.int64)
    columns, accuracy = records.columns(canvas.dtype), canvas.dtype.type(checked_accuracy(a))
    _count(canvas.position, canvas.normal, canvas.tiles, columns, accuracy, WEIGHTS[weight], counts)
    return counts


def needed(
    canvas: Canvas, records: Records, sure: NDArray[np.bool_], a: float, weight: Weight = "ward", others: int = 1
) -> NDArray[np.bool_]:
    """Which of K records reach a pixel that fewer than `others` ≥ 1 before them reach, (K,): those that are `sure` (K,) come first,
    in order. Records that aren't needed don't count."""
    order = np.argsort(~sure, kind="stable")
    columns, accuracy = records.rows(order).columns(canvas.dtype), canvas.dtype.type(checked_accuracy(a))
    found, reached = np.zeros(len(order), bool), np.zeros(len(canvas), np.int32)
    _walk(canvas.position, canvas.normal, canvas.tiles, columns, accuracy, WEIGHTS[weight], sure[order], others, reached, found)
    out = np.empty(len(order), bool)
    out[order] = found
    return out


@numba.njit(nogil=True, cache=True)
def _walk(points, normals, tiles, records, a, kind, sure, others, counts, found):  # type: ignore[no-untyped-def]
    reached = np.empty(len(tiles.pixel), np.int64)
    inside = np.empty(len(points), np.int64)
    for k in range(len(records.position)):
        position, normal, radius = records.position[k], records.normal[k], records.radius[k]
        count = 0
        for t in tiles_reached(tiles, 0, len(tiles.first) - 1, position, normal, radius, a, reached):
            for i in tiles.pixel[t]:
                if i >= 0 and weight_at(kind, points[i], normals[i], position, normal, radius, a) > 0:
                    inside[count] = i
                    count += 1
                    if counts[i] < others:
                        found[k] = True
        if found[k] or sure[k]:
            for j in range(count):
                counts[inside[j]] += 1


@numba.njit(parallel=True, cache=True)
def _count(points, normals, tiles, records, a, kind, counts):  # type: ignore[no-untyped-def]
    for k in numba.prange(len(records.position)):
        position, normal, radius = records.position[k], records.normal[k], records.radius[k]
        found, reached = 0, np.empty(len(tiles.pixel), np.int64)
        for t in tiles_reached(tiles, 0, len(tiles.first) - 1, position, normal, radius, a, reached):
            for i in tiles.pixel[t]:
                if i >= 0 and weight_at(kind, points[i], normals[i], position, normal, radius, a) > 0:
                    found += 1
        counts[k] = found
