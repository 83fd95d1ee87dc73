"""Records see their zones: one that doesn't shrinks until it does, so that no light leaks through thin walls.

A zone is a ball, whatever stands in it: through a wall thinner than the zone, and from the top of a fence, a record reaches places
where the light is another. Neither the curvature of the irradiance nor distances averaged over a hemisphere tell. Two rules:

below    R ← min(R, min |p - p_k| / a)     over pixels p of the zone with (p - p_k)·(n + n_k)/2 < -DROP |p - p_k|
hidden   R ← min(R, min |p - p_k| / a)     over pixels p of the zone beyond the clearance that p_k doesn't see

What is below the tangent plane is not in the record's hemisphere. For the second rule, where something stands nearer than the zone
is wide (`gradients.Moments.clearance`), up to SAMPLES pixels beyond it, evenly spread over the zone, are looked at from the record.
Both ends are lifted off their surfaces along the normals by LIFT of their distance, which clears convex surfaces (the chord runs
under the surface by an eighth of the angle between the normals), and by half of the clearance at most. In the corners of a room all
of a zone is seen, and nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Records
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.splat_kernels import tiles_reached, weight_at
from renderers.transport.caching.weights import WEIGHTS, Weight

F64 = NDArray[np.float64]
Blocked = Callable[[F64, F64, F64], NDArray[np.bool_]]
SAMPLES = 256
LIFT = 0.1
DROP = 0.25  # of the distance: 14° below
INSIDE = 1 - 1e-3  # of the distance of a hidden pixel, so that it stays outside in float32 too


def in_sight(records: Records, canvas: Canvas, a: float, weight: Weight, blocked: Blocked) -> Records:
    """Records whose zones at accuracy a hold no pixel of a canvas that lies below them or was found to be hidden from them.

    blocked: `RayCaster.occluded`. Records that know no clearance are all looked from.
    """
    nearest = np.full(len(records), np.inf)
    columns, accuracy = records.columns(canvas.dtype), canvas.dtype.type(a)
    _nearest_below(canvas.position, canvas.normal, canvas.tiles, columns, accuracy, WEIGHTS[weight], nearest)
    records = records.with_radius(np.minimum(records.radius, INSIDE * nearest / a))
    clearance = np.zeros(len(records)) if records.clearance is None else np.asarray(records.clearance, np.float64)
    wide = np.flatnonzero(a * records.radius > clearance)
    nearest[wide] = _nearest_hidden(records.rows(wide), clearance[wide], canvas, a, weight, blocked)
    return records.with_radius(np.minimum(records.radius, INSIDE * nearest / a))


def _nearest_hidden(records: Records, clearance: F64, canvas: Canvas, a: float, weight: Weight, blocked: Blocked) -> F64:
    """Distance of the nearest pixel beyond the clearance that was found to be hidden, (K,), ∞ where none was."""
    nearest = np.full(len(records), np.inf)
    chosen = np.full((len(records), SAMPLES), -1, np.int64)
    columns, accuracy = records.columns(canvas.dtype), canvas.dtype.type(a)
    _choose(
        canvas.position, canvas.normal, canvas.tiles, columns, clearance.astype(canvas.dtype), accuracy, WEIGHTS[weight], chosen
    )
    record, place = np.nonzero(chosen >= 0)
    pixel = chosen[record, place]
    distance = np.linalg.norm(canvas.position[pixel] - records.position[record], axis=1)
    near = clearance[record] / 2
    lift = np.where(near > 0, np.minimum(LIFT * distance, near), LIFT * distance)[:, None]
    start = records.position[record] + lift * records.normal[record]
    way = canvas.position[pixel] + lift * canvas.normal[pixel] - start
    hidden = blocked(start, way, np.full(len(way), INSIDE))
    np.minimum.at(nearest, record[hidden], distance[hidden])
    return nearest


@numba.njit(parallel=True, cache=True)
def _nearest_below(points, normals, tiles, records, a, kind, nearest):  # type: ignore[no-untyped-def]
    """nearest (K,): distance of the nearest pixel of each record's zone that lies below it, untouched where none does."""
    for k in numba.prange(len(nearest)):
        position, normal, radius = records.position[k], records.normal[k], records.radius[k]
        reached = np.empty(len(tiles.pixel), np.int64)
        for t in tiles_reached(tiles, 0, len(tiles.first) - 1, position, normal, radius, a, reached):
            for i in tiles.pixel[t]:
                if i < 0:
                    continue
                height, square = 0.0, 0.0
                for c in range(3):
                    step = points[i, c] - position[c]
                    square += step * step
                    height += step * (normals[i, c] + normal[c]) / 2
                distance = np.sqrt(square)
                if height >= -DROP * distance or distance >= nearest[k]:
                    continue
                if weight_at(kind, points[i], normals[i], position, normal, radius, a) > 0:
                    nearest[k] = distance


@numba.njit(parallel=True, cache=True)
def _choose(points, normals, tiles, records, clearance, a, kind, chosen):  # type: ignore[no-untyped-def]
    """chosen (K, SAMPLES): pixels of each record, -1 for none: every m-th of those that count, in the order of the tiles."""
    for k in numba.prange(len(clearance)):
        position, normal, radius = records.position[k], records.normal[k], records.radius[k]
        reached = np.empty(len(tiles.pixel), np.int64)
        reached = tiles_reached(tiles, 0, len(tiles.first) - 1, position, normal, radius, a, reached)
        zone = (reached, position, normal, radius, a, clearance[k])
        count = _beyond(points, normals, tiles, zone, kind, 0, chosen[k])
        if count:
            _beyond(points, normals, tiles, zone, kind, (count - 1) // chosen.shape[1] + 1, chosen[k])


@numba.njit(cache=True)
def _beyond(points, normals, tiles, zone, kind, stride, chosen):  # type: ignore[no-untyped-def]
    """How many pixels of a zone lie beyond its record's clearance; every stride-th of them is noted, none for stride 0."""
    reached, position, normal, radius, a, clearance = zone
    count = 0
    for t in reached:
        for i in tiles.pixel[t]:
            if i < 0 or weight_at(kind, points[i], normals[i], position, normal, radius, a) <= 0:
                continue
            square = 0.0
            for c in range(3):
                square += (points[i, c] - position[c]) ** 2
            if square > clearance**2:
                if stride and count % stride == 0:
                    chosen[count // stride] = i
                count += 1
    return count
