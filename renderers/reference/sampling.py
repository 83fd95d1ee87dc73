"""Paths through chosen points of pixels: `spp` samples a pixel, box-filtered or all from one point, summed in float64.

Streams: the sampler is Mitsuba's `multijitter` (never `ldsampler`: its mean is off by up to 0.75 %, which replicates can't see),
but `independent` for fewer than MULTIJITTER_LEAST samples a pixel: there the strata of one dimension tell those of the others, and
long paths lose energy (white furnace of albedo 0.9: -3.5 % at 4 samples, -1.8 % at 16, nothing from 36 on).
Bits of its seed: 31 = 0 for references, 1 for the method `pt`, so that a picture and its truth never share paths. For references,
30..16 are the band of pixel rows and 15..0 the replicate number (an image of one band is seeded with the replicate number itself).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from math import isqrt
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderers.reference.variant import mitsuba

mi = mitsuba()
F64 = NDArray[np.float64]
Point = tuple[float, float]
# radiance(scene, sampler, ray, active) of one wavefront: Color3f
Estimator = Callable[[Any, Any, Any, Any], Any]
# Lanes of one wavefront: bounds memory (about 100 bytes a lane) and never depends on the machine, since it decides the seeds.
LANES = 1 << 22
CENTRE = (0.5, 0.5)
MULTIJITTER_LEAST = 64


def mean_image(
    scene: Any,
    estimate: Estimator,
    size: tuple[int, int],
    spp: int,
    stream: Callable[[int], int],
    point: Point | None,
    *,
    active: bool = True,
) -> F64:
    """Mean radiance of `spp` paths a pixel, float64 (H, W, 3), row 0 on top.

    point: where in the pixel every path starts, (0.5, 0.5) the centre; None spreads them over the pixel (box filter).
    stream: seed of a band of rows. active=False compiles the very same kernels and traces nothing: the warm-up.
    Raises FloatingPointError when a path returns a number that is not finite.
    """
    width, height = size
    most = max(1, LANES // (width * spp))
    bands = []
    for band, top in enumerate(range(0, height, most)):
        rows = min(most, height - top)
        sampler, ray = _wavefront(scene, size, spp, stream(band), point, top, rows)
        radiance = np.asarray(estimate(scene, sampler, ray, dr.opaque(mi.Bool, active)), dtype=np.float32)
        bad = int(np.count_nonzero(~np.isfinite(radiance)))
        if bad:
            raise FloatingPointError(f"{bad} of {radiance.size} path values are not finite")
        means = radiance.reshape(3, width * rows, spp).sum(axis=2, dtype=np.float64) / spp
        bands.append(means.T.reshape(rows, width, 3))
    return np.concatenate(bands)


def reference_stream(replicate: int) -> Callable[[int], int]:
    """Seeds of one replicate (0 … 65535) of a reference."""
    if not 0 <= replicate < 1 << 16:
        raise ValueError(f"replicate must lie in 0..65535, got {replicate}")
    return lambda band: (band & 0x7FFF) << 16 | replicate


def method_stream(seed: int, number: int, frame: int = 0) -> Callable[[int], int]:
    """Seeds of pass `number` of a path-traced picture with `seed`: disjoint from those of references, others in every frame."""

    def stream(band: int) -> int:
        digest = hashlib.sha256(f"{seed} {(frame << 32) + number} {band}".encode()).digest()
        return 0x80000000 | int.from_bytes(digest[:4], "big")

    return stream


def grid_sizes(spp: int, largest: int = 256) -> list[int]:
    """`spp` split into passes that multijitter can lay out exactly (k·k, k·(k+1) or k·(k+2) samples), largest first."""
    sizes = []
    while spp:
        part = min(spp, largest)
        while isqrt(part) * -(-part // isqrt(part)) != part:
            part -= 1
        sizes.append(part)
        spp -= part
    return sizes


def _wavefront(scene: Any, size: tuple[int, int], spp: int, seed: int, point: Point | None, top: int, rows: int) -> tuple[Any, Any]:
    """Sampler and camera rays of pixel rows top … top + rows: lane = (row · width + column) · spp + sample."""
    width, height = size
    lanes = width * rows * spp
    sampler = mi.load_dict({"type": "multijitter" if spp >= MULTIJITTER_LEAST else "independent", "sample_count": spp})
    sampler.set_samples_per_wavefront(spp)
    # Opaque numbers don't enter the compiled kernel: replicates, bands and sizes share one.
    sampler.seed(dr.opaque(mi.UInt32, seed), lanes)
    columns, lines, first = (dr.opaque(mi.UInt32, n) for n in (width, height, top))
    pixel = dr.arange(mi.UInt32, lanes) // spp
    row = pixel // columns
    corner = mi.Point2f(pixel - row * columns, row + first)
    inside = sampler.next_2d() if point is None else mi.Point2f(*(dr.opaque(mi.Float, x) for x in point))
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, (corner + inside) / mi.Point2f(columns, lines), mi.Point2f(0.5))
    return sampler, mi.Ray3f(ray)
