"""Radiance records splatted: reflected radiance of glossy pixels, interpolated between records inside their zones.

    L(p, v) = Σ_k w_k max(0, Σ_i c_i(v) λ'_i) / Σ_k w_k,    λ' = T(F_p F_kᵀ) (λ_k + δ_x ∂_xλ_k + δ_y ∂_yλ_k)      Gautron 2006, 4.4

δ is p - p_k along the record's tangents; T turns coefficients from the record's frame F_k into the pixel's, F_p: on curved surfaces
a tilt of 2° without it costs a tenth of the radiance already. Where both frames agree, T is left out. Extrapolation comes first:
the derivatives live in the record's frame. Weights and zones are those of irradiance records.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.glossy_kernels import splat_radiance
from renderers.transport.caching.records import Records
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.weights import WEIGHTS, Weight, checked_accuracy
from renderers.transport.hemispherical.basis import order_of
from renderers.transport.hemispherical.lune import lune_table
from renderers.transport.sampling import frame
from renderers.transport.threads import chunks
from renderers.transport.tiles import tiles_of

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Reflectance = Callable[[slice], F32]
PIXELS = 1 << 13  # a band: their coefficients are held at once, 12 n² bytes a pixel


class RadianceColumns(NamedTuple):
    """Radiance records as kernels read them, float32: position, normal (K, 3), radius (K,), tangents (K, 2, 3), and coefficients
    (K, 3, 3, n²): value, derivatives along the tangents; channel; function."""

    position: F32
    normal: F32
    radius: F32
    tangents: F32
    coefficients: F32


def radiance_columns(records: Records, gradients: bool = True) -> RadianceColumns:
    """Columns of records. Raises ValueError where they carry no coefficients."""
    if records.coefficients is None or records.coefficient_gradients is None:
        raise ValueError("these records carry no radiance")
    slope = records.coefficient_gradients if gradients else np.zeros_like(records.coefficient_gradients)
    parts = np.concatenate([records.coefficients[:, None], slope], axis=1).transpose(0, 1, 3, 2)
    tangents = records.tangents
    if tangents is None:
        tangents = np.stack(frame(records.normal.astype(np.float64)), axis=1)
    columns = records.position, records.normal, records.radius, tangents, parts
    return RadianceColumns(*(np.ascontiguousarray(column, np.float32) for column in columns))


@cache
def warm_up(order: int) -> None:
    """Compile (or load) the kernels and make the tables of turns of an order; once a process."""
    point, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    zeros, light = np.zeros((1, 3, 3)), np.zeros((1, order**2, 3))
    records = Records(point, up, np.ones(1), point, zeros, zeros, light, np.zeros((1, 2, order**2, 3)))
    canvas = Canvas(np.zeros(1, np.intp), 1, point, up)
    reflected(canvas, records, lambda part: np.zeros((1, 3, order**2), np.float32), 0.1)


def reflected(
    canvas: Canvas,
    records: Records,
    reflectance: Reflectance,
    a: float,
    weight: Weight = "ward",
    gradients: bool = True,
    counters: Counter[str] | None = None,
) -> F64:
    """Reflected radiance float64 (P, 3) of a canvas's pixels; 0 where no record reaches.

    reflectance: coefficients of f_r cos θ_i, float32 (N, 3, n²), of a slice of the pixels, in the frames `sampling.frame(normal)`
    (`reflectance.Lobes`, or a `BrdfTable`'s look-ups). counters: `glossy_splats` (pairs) and `glossy_turns` (those that needed a
    turn) are added to.
    """
    out = np.zeros((len(canvas), 3))
    if not len(records):
        return out
    columns = radiance_columns(records, gradients)
    table = lune_table("rotation", order_of(columns.coefficients.shape[-1]))
    accuracy = np.float32(checked_accuracy(a))
    for part in chunks(len(canvas), PIXELS):
        position, normal = (np.ascontiguousarray(x[part], np.float32) for x in (canvas.position, canvas.normal))
        tiles = tiles_of(canvas.rows[part], canvas.width, position, normal)
        tangents = np.stack(frame(normal.astype(np.float64)), axis=1).astype(np.float32)
        sums, work = np.zeros((len(position), 4), np.float32), np.zeros((len(tiles.first) - 1, 2), np.int64)
        pixels = position, normal, tangents, reflectance(part)
        splat_radiance(pixels, tiles, columns, table, accuracy, WEIGHTS[weight], sums, work)
        total = sums[:, 3:].astype(np.float64)
        out[part] = np.where(total > 0, sums[:, :3] / np.where(total > 0, total, 1), 0)
        if counters is not None:
            counters["glossy_splats"] += int(work[:, 0].sum())
            counters["glossy_turns"] += int(work[:, 1].sum())
    return out
