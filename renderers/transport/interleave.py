"""Interleaved sub-images and the guided bilateral filter that joins them again (Laurent 2018 §5.6.4).

Pixel (i, j) of the image belongs to sub-image (i mod s, j mod s). Each light goes to one of the s² sub-images, drawn at random,
with s² times its intensity (the factor is missing in the thesis; without it the mean falls to 1/s²).
"""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.transport.fused import fma
from renderers.transport.kernels import ONE, ZERO

F32 = NDArray[np.float32]
PLANE = 0.01
LOG2_E, HALF = np.float32(np.log2(np.e)), np.float32(0.5)


def sub_images(gbuffer: GBuffer, side: int) -> Iterator[tuple[tuple[slice, slice], GBuffer]]:
    """The side² sub-images with their places in the whole; each is the G-buffer of a camera with that offset in its larger pixels.

    Raises ValueError unless side divides width and height.
    """
    width, height = gbuffer.size
    if width % side or height % side:
        raise ValueError(f"{side}x{side} interleaved sub-images need a width and height divisible by {side}, got {width}x{height}")
    for index in range(side * side):
        row, column = divmod(index, side)
        place = slice(row, None, side), slice(column, None, side)
        offset = (column + gbuffer.offset[0]) / side, (row + gbuffer.offset[1]) / side
        yield (
            place,
            GBuffer(
                np.ascontiguousarray(gbuffer.position[place]),
                np.ascontiguousarray(gbuffer.normal[place]),
                np.ascontiguousarray(gbuffer.base[place]),
                np.ascontiguousarray(gbuffer.emission[place]),
                np.ascontiguousarray(gbuffer.triangle[place]),
                np.ascontiguousarray(gbuffer.material[place]),
                gbuffer.eye,
                offset,
            ),
        )


def joined(image: F32, gbuffer: GBuffer, side: int) -> F32:
    """Bilateral filter over (2·side - 1)² pixels, float32 (H, W, 3).

    Weights: a tent, in which all sub-images have equal shares; (n·n')^32; exp(-(n·(x'-x) / 0.01)²), in sizes of the World.
    """
    out = np.empty_like(image)
    columns = gbuffer.position / PLANE, gbuffer.normal, image
    position, normal, radiance = (np.ascontiguousarray(np.moveaxis(a, 2, 1), np.float32) for a in columns)
    _filter(position, normal, radiance, gbuffer.covered.astype(np.float32), side, out)
    return out


@numba.njit(inline="always")
def _gaussian(t):  # type: ignore[no-untyped-def]
    """exp(-t²) of a float32 to 3e-7: 2^n times a polynomial on [-½, ½], Cephes' for 2^x; 0 from t² = 87 on."""
    x = max(np.float32(-t * t) * LOG2_E, np.float32(-125))
    n = np.floor(x + HALF)
    f = x - n
    p = fma(np.float32(1.535336188319500e-4), f, np.float32(1.339887440266574e-3))
    p = fma(p, f, np.float32(9.618437357674640e-3))
    p = fma(p, f, np.float32(5.550332471162809e-2))
    p = fma(p, f, np.float32(2.402264791363012e-1))
    p = fma(p, f, np.float32(6.931472028550421e-1))
    power = np.int32((np.int32(n) + np.int32(127)) << np.int32(23)).view(np.float32)
    return fma(p, f, ONE) * power


@numba.njit(error_model="numpy")
def _add_row(position, normal, other, facing, image, covered, u, tent, sums):  # type: ignore[no-untyped-def]
    """Add the pixels u columns to the right, of another row, to a row's sums (4, W): weight, red, green, blue."""
    width = covered.shape[0]
    low, count = max(0, -u), width - abs(u)
    a, b, c = normal[0, low:], normal[1, low:], normal[2, low:]
    x, y, z = position[0, low:], position[1, low:], position[2, low:]
    first = low + u
    d, e, f = facing[0, first:], facing[1, first:], facing[2, first:]
    p, q, r = other[0, first:], other[1, first:], other[2, first:]
    red, green, blue, there = image[0, first:], image[1, first:], image[2, first:], covered[first:]
    for i in range(count):
        along = max(ZERO, fma(a[i], d[i], fma(b[i], e[i], c[i] * f[i])))
        along *= along
        along *= along
        along *= along
        along *= along
        along *= along
        apart = fma(a[i], p[i] - x[i], fma(b[i], q[i] - y[i], c[i] * (r[i] - z[i])))
        w = tent * there[i] * along * _gaussian(apart)
        sums[0, low + i] += w
        sums[1, low + i] += w * red[i]
        sums[2, low + i] += w * green[i]
        sums[3, low + i] += w * blue[i]


@numba.njit(parallel=True, cache=True)
def _filter(position, normal, image, covered, side, out):  # type: ignore[no-untyped-def]
    """Rows (H, 3, W), positions over PLANE; covered float32 (H, W). Whole rows are added side by side, in vector lanes."""
    height, width = covered.shape
    for y in numba.prange(height):
        sums = np.zeros((4, width))
        for v in range(max(0, y - side + 1), min(height, y + side)):
            for u in range(max(1 - side, 1 - width), min(side, width)):
                tent = np.float32((side - abs(u)) * (side - abs(v - y)))
                _add_row(position[y], normal[y], position[v], normal[v], image[v], covered[v], u, tent, sums)
        for x in range(width):
            for c in range(3):
                out[y, x, c] = sums[c + 1, x] / sums[0, x] if covered[y, x] > 0 else 0
