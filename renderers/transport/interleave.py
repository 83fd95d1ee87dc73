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

F32 = NDArray[np.float32]
NORMAL_POWER = 32.0
PLANE = 0.01


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
    _filter(image, gbuffer.position, gbuffer.normal, gbuffer.covered, side, out)
    return out


@numba.njit(parallel=True, cache=True)
def _filter(image, position, normal, covered, side, out):  # type: ignore[no-untyped-def]
    height, width = covered.shape
    for y in numba.prange(height):
        for x in range(width):
            out[y, x] = 0
            if not covered[y, x]:
                continue
            total, n, p = 0.0, normal[y, x], position[y, x]
            red = green = blue = 0.0
            for v in range(max(0, y - side + 1), min(height, y + side)):
                for u in range(max(0, x - side + 1), min(width, x + side)):
                    if not covered[v, u]:
                        continue
                    other, q = normal[v, u], position[v, u]
                    along = n[0] * other[0] + n[1] * other[1] + n[2] * other[2]
                    if along <= 0:
                        continue
                    apart = (n[0] * (q[0] - p[0]) + n[1] * (q[1] - p[1]) + n[2] * (q[2] - p[2])) / PLANE
                    w = (side - abs(u - x)) * (side - abs(v - y)) * along**NORMAL_POWER * np.exp(-apart * apart)
                    total += w
                    red += w * image[v, u, 0]
                    green += w * image[v, u, 1]
                    blue += w * image[v, u, 2]
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / total, green / total, blue / total
