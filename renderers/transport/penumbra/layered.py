"""Layered attenuation maps (Agrawala, Ramamoorthi, Heirich & Moll 2000): hidden shares where surfaces were seen, and nowhere else.

Every texel of every shadow map is a surface point that one light point sees; it is dropped into the pixel of the central pyramid
that holds it. Points of a pixel within a tolerance in depth form a layer; the light points among them are those that see it:

    V = 1 - (light points in the layer) / N

A lookup takes the layer at the point's depth, and is fully shadowed where there is none: what no map saw, and what fell between the
maps' texels. For large lights those holes are many (St-Amour 2004 §2.4), and no value exists off the surfaces.
"""

from __future__ import annotations

from collections import Counter

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.penumbra.build import Filter, by_face, casters_of, drawn, map_maker, pyramids_of
from renderers.transport.penumbra.cameras import DU, DV, U0, V0, S, cameras_of
from renderers.transport.penumbra.emitters import Emitter
from renderers.transport.penumbra.lookup import UNCOVERED
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.threads import chunks

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
BATCH = 16


class LayeredMap:
    """Layers of all pixels of one pyramid. tolerance: depth within which points are one layer, in footprints of a pixel."""

    def __init__(self, pyramid: Pyramid, cameras: F64, maps: F32, tolerance: float) -> None:
        self.pyramid, self._tolerance = pyramid, tolerance * pyramid.pitch
        window = np.array([*pyramid.low, pyramid.pitch, pyramid.near, pyramid.far])
        found = [seen(cameras[part], maps[part], window, pyramid.width, pyramid.height) for part in chunks(len(maps), BATCH)]
        pixel, z = (np.concatenate(column) for column in list(zip(*found, strict=True))[:2])
        light = np.concatenate([one[2] + BATCH * k for k, one in enumerate(found)])
        order = np.lexsort((light, z, pixel))
        self.start, self.depth, self.value = layers(
            pixel[order], z[order], light[order], pyramid.width * pyramid.height, len(maps), self._tolerance
        )

    def hidden(self, local: F64, filter: Filter = "bilinear") -> F32:
        """Hidden share at points (P, 3) of the pyramid's frame, float32 (P,); -1 outside of it."""
        p = self.pyramid
        out = np.empty(len(local), np.float32)
        window = np.array([p.low[0], p.low[1], p.pitch, p.near, p.far])
        read(np.ascontiguousarray(local), window, p.width, p.height, self._tolerance, self.start, self.depth, self.value,
             filter == "bilinear", out)  # fmt: skip
        return out


class LayeredLight:
    """Layered attenuation maps around one emitter, from light points (N, 3), World."""

    def __init__(
        self, world: World, emitter: Emitter, points: F64, resolution: int, map_resolution: int, near: float, tolerance: float,
        counters: Counter[str],
    ) -> None:  # fmt: skip
        self._emitter = emitter
        self._maps = []
        cast = casters_of(world, emitter)
        for pyramid in pyramids_of(world, emitter, points, resolution, near):
            cameras = cameras_of(pyramid, pyramid.local(points), map_resolution)
            maps = drawn(map_maker(pyramid, cast, (map_resolution, map_resolution)), cameras)
            self._maps.append(LayeredMap(pyramid, cameras, maps, tolerance))
            counters["shadow_maps"] += len(cameras)
            counters["layers"] += len(self._maps[-1].depth)

    def hidden(self, positions: F64, filter: Filter) -> F32:
        """Hidden share at World points (P, 3), float32 (P,); -1 where no pyramid reaches."""
        out = np.full(len(positions), UNCOVERED, np.float32)
        faces = by_face(self._emitter, [m.pyramid for m in self._maps], positions)
        for one, (rows, local) in zip(self._maps, faces, strict=True):
            out[rows] = one.hidden(local, filter)
        return out


@numba.njit(nogil=True, cache=True)
def seen(cameras, maps, window, width, height):  # type: ignore[no-untyped-def]
    """Surface points of maps float32 (N, h, w) in the pixels of the pyramid: pixel int32, depth float32, map int32 (E,)."""
    size = maps.size
    pixel, z, light = np.empty(size, np.int32), np.empty(size, np.float32), np.empty(size, np.int32)
    count = 0
    for i in range(len(maps)):
        camera = cameras[i]
        for row in range(maps.shape[1]):
            v = camera[V0] + (row + 0.5) * camera[DV]
            for column in range(maps.shape[2]):
                d = maps[i, row, column]
                if not np.isfinite(d):
                    continue
                u = camera[U0] + (column + 0.5) * camera[DU]
                depth = d + camera[S + 2]
                if not (depth >= window[3] and depth <= window[4]):
                    continue
                x = int(np.floor(((u * d + camera[S]) / depth - window[0]) / window[2]))
                y = int(np.floor(((v * d + camera[S + 1]) / depth - window[1]) / window[2]))
                if 0 <= x < width and 0 <= y < height:
                    pixel[count], z[count], light[count] = y * width + x, depth, i
                    count += 1
    return pixel[:count].copy(), z[:count].copy(), light[:count].copy()


@numba.njit(nogil=True, cache=True)
def layers(pixel, z, light, pixels, samples, tolerance):  # type: ignore[no-untyped-def]
    """Layers of points sorted by pixel and depth: start int64 (pixels + 1,), depth (its middle) and value float32 (L,)."""
    counts = np.zeros(pixels + 1, np.int64)
    depth, value = np.empty(len(z), np.float32), np.empty(len(z), np.float32)
    last_layer = np.full(samples, -1, np.int64)
    n, k = 0, 0
    while k < len(z):
        first, own, here = k, pixel[k], 0
        while k < len(z) and pixel[k] == own and z[k] - z[first] <= tolerance * z[first]:
            if last_layer[light[k]] != n:
                last_layer[light[k]] = n
                here += 1
            k += 1
        depth[n], value[n] = (z[first] + z[k - 1]) / 2, 1 - here / samples
        counts[own + 1] += 1
        n += 1
    return np.cumsum(counts), depth[:n].copy(), value[:n].copy()


@numba.njit(parallel=True, cache=True)
def read(points, window, width, height, tolerance, start, depth, value, bilinear, out):  # type: ignore[no-untyped-def]
    """out float32 (P,): share of the layer nearest to the depth of points float64 (P, 3), blended over the pixels that have one."""
    for i in numba.prange(len(points)):
        z = points[i, 2]
        gx = (points[i, 0] / z - window[0]) / window[2] if z > 0 else -1.0
        gy = (points[i, 1] / z - window[1]) / window[2] if z > 0 else -1.0
        if not (z >= window[3] and z <= window[4] and gx >= 0 and gx <= width and gy >= 0 and gy <= height):
            out[i] = UNCOVERED
            continue
        first_x, first_y = (gx - 0.5, gy - 0.5) if bilinear else (np.floor(gx), np.floor(gy))
        x, y = int(np.floor(first_x)), int(np.floor(first_y))
        wx, wy = first_x - x, first_y - y
        total, weights = 0.0, 0.0
        for b in range(2):
            row = min(max(y + b, 0), height - 1)
            for a in range(2):
                pixel = row * width + min(max(x + a, 0), width - 1)
                weight = (wx if a else 1 - wx) * (wy if b else 1 - wy)
                best, share = tolerance * z, -1.0
                for k in range(start[pixel], start[pixel + 1]):
                    if abs(depth[k] - z) <= best:
                        best, share = abs(depth[k] - z), value[k]
                if share >= 0:
                    total += weight * share
                    weights += weight
        out[i] = total / weights if weights > 0 else 1.0
