"""Peers of penumbra deep shadow maps: hidden shares read from plain shadow maps (numba kernels and what feeds them).

    averaged    the mean of N shadow tests at the point itself (Brotman & Badler 1984)
    hard, pcf   one map at the light's centre: one test, or the mean of tests over a fixed window of texels (Reeves et al. 1987)
    pcss        the window as wide as the penumbra of the mean blocker: w (Z - Z_b) / (Z_b Z) in tangents (Fernando 2005)

A tap compares its texel with the depth that the receiver's own plane has there (receiver-plane bias), so windows of any width
don't shadow the plane they lie on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.penumbra.build import by_face, casters_of, drawn, map_maker, pyramids_of
from renderers.transport.penumbra.cameras import DU, DV, U0, V0, S, cameras_of
from renderers.transport.penumbra.emitters import Emitter
from renderers.transport.penumbra.pyramid import Pyramid

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
# kernel(pyramid, cameras, maps, points, normals, extent) gives hidden shares; prefilter(pyramid, cameras, maps) what it reads of
# maps
Kernel = Callable[[Pyramid, F64, Any, F64, F64, F64], F32]
Prefilter = Callable[[Pyramid, F64, F32], Any]
SEARCH_TAPS = 16


class FilteredMaps:
    """Plain shadow maps around one emitter, and a kernel that reads a hidden share from them.

    points (N, 3), World: camera positions; extent: half size (2,) of the light across each face's axis comes from `light` (M, 3).
    prefilter: what kernels read instead of the maps.
    """

    def __init__(
        self, world: World, emitter: Emitter, points: F64, light: F64, resolution: int, near: float, counters: Counter[str],
        prefilter: Prefilter | None = None,
    ) -> None:  # fmt: skip
        self._emitter = emitter
        self._pyramids = pyramids_of(world, emitter, light, resolution, near)
        self._parts = []
        cast = casters_of(world, emitter)
        for pyramid in self._pyramids:
            cameras = cameras_of(pyramid, pyramid.local(points), resolution)
            extent = np.abs(pyramid.local(light)[:, :2]).max(axis=0)
            maps = drawn(map_maker(pyramid, cast, (resolution, resolution)), cameras)
            self._parts.append((cameras, maps if prefilter is None else prefilter(pyramid, cameras, maps), extent))
            counters["shadow_maps"] += len(cameras)

    def hidden(self, positions: F64, normals: F64, kernel: Kernel) -> F32:
        """Hidden share at World points (P, 3) with normals (P, 3), float32 (P,); -1 where no pyramid reaches."""
        out = np.full(len(positions), -1, np.float32)
        faces = by_face(self._emitter, self._pyramids, positions)
        for pyramid, (cameras, maps, extent), (rows, local) in zip(self._pyramids, self._parts, faces, strict=True):
            covered = (local[:, 2] >= pyramid.near) & (local[:, 2] <= pyramid.far)
            tangents = local[:, :2] / np.where(covered, local[:, 2], 1.0)[:, None]
            edge = np.array(pyramid.low) + pyramid.pitch * np.array([pyramid.width, pyramid.height])
            covered &= ((tangents >= pyramid.low) & (tangents <= edge)).all(axis=1)
            kept = rows[covered]
            if len(kept):
                normal = np.ascontiguousarray(normals[kept] @ pyramid.rotation.T)
                out[kept] = kernel(pyramid, cameras, maps, np.ascontiguousarray(local[covered]), normal, extent)
        return out


def averaged(bias: float) -> Kernel:
    """The mean of one test per map."""

    def kernel(pyramid: Pyramid, cameras: F64, maps: F32, points: F64, normals: F64, extent: F64) -> F32:
        out = np.zeros(len(points), np.float32)
        mean_of_tests(points, normals, cameras, maps, bias, out)
        return out

    return kernel


def percentage_closer(bias: float, taps: int) -> Kernel:
    """One map; the mean of taps² tests, a texel apart; taps 1 is the hard test."""

    def kernel(pyramid: Pyramid, cameras: F64, maps: F32, points: F64, normals: F64, extent: F64) -> F32:
        half = np.tile(cameras[0, [DU, DV]] * (taps - 1) / 2, (len(points), 1))
        out = np.zeros(len(points), np.float32)
        window(points, normals, cameras[0], maps[0], bias, half, taps, False, out)
        return out

    return kernel


def soft(bias: float, taps: int) -> Kernel:
    """One map; blocker search over what the light covers of the near plane, then taps² tests over the penumbra's width."""

    def kernel(pyramid: Pyramid, cameras: F64, maps: F32, points: F64, normals: F64, extent: F64) -> F32:
        z = points[:, 2]
        blocker, out = np.zeros(len(points), np.float32), np.zeros(len(points), np.float32)
        window(points, normals, cameras[0], maps[0], bias, extent * (1 / pyramid.near - 1 / z)[:, None], SEARCH_TAPS, True, blocker)
        rows = np.flatnonzero(blocker > 0)
        near = blocker[rows].astype(np.float64)
        half = extent * np.maximum((z[rows] - near) / (near * z[rows]), 0)[:, None]
        shares = np.zeros(len(rows), np.float32)
        window(points[rows], normals[rows], cameras[0], maps[0], bias, half, taps, False, shares)
        out[rows] = shares
        return out

    return kernel


@numba.njit(inline="always")
def _plane_depth(p, n, s, u, v):  # type: ignore[no-untyped-def]
    """Depth at which the ray (u, v, 1) from s meets the plane through p with normal n, kept within a factor 2 of p's own."""
    own = p[2] - s[2]
    across = n[0] * u + n[1] * v + n[2]
    height = n[0] * (p[0] - s[0]) + n[1] * (p[1] - s[1]) + n[2] * own
    if across * height <= 0:
        return own
    return min(max(height / across, own / 2), 2 * own)


@numba.njit(parallel=True, cache=True)
def mean_of_tests(points, normals, cameras, maps, bias, out):  # type: ignore[no-untyped-def]
    """out float32 (P,): share of maps float32 (N, h, w) that hide points float64 (P, 3); normals float64 (P, 3), pyramid's
    frame.
    """
    for i in numba.prange(len(points)):
        blocked = 0
        for k in range(len(cameras)):
            camera, depth = cameras[k], maps[k]
            s = (camera[S], camera[S + 1], camera[S + 2])
            z = points[i, 2] - s[2]
            if z <= 0:
                continue
            x = int(np.floor(((points[i, 0] - s[0]) / z - camera[U0]) / camera[DU]))
            y = int(np.floor(((points[i, 1] - s[1]) / z - camera[V0]) / camera[DV]))
            if 0 <= x < depth.shape[1] and 0 <= y < depth.shape[0]:
                u, v = camera[U0] + (x + 0.5) * camera[DU], camera[V0] + (y + 0.5) * camera[DV]
                blocked += depth[y, x] + bias < _plane_depth(points[i], normals[i], s, u, v)
        out[i] = blocked / len(cameras)


@numba.njit(parallel=True, cache=True)
def window(points, normals, camera, depth, bias, half, taps, search, out):  # type: ignore[no-untyped-def]
    """Regular taps² over tangents ± half (P, 2) around each point: share of blocked ones, or (search) mean depth of blocking
    texels.

    out float32 (P,), 0 without blockers. points, normals float64 (P, 3), pyramid's frame; camera (CAMERA,); depth float32 (h, w).
    """
    s = (camera[S], camera[S + 1], camera[S + 2])
    for i in numba.prange(len(points)):
        z = points[i, 2] - s[2]
        u0, v0 = (points[i, 0] - s[0]) / z, (points[i, 1] - s[1]) / z
        blocked, total = 0, 0.0
        for a in range(taps):
            for b in range(taps):
                u = u0 + half[i, 0] * ((2 * a + 1) / taps - 1)
                v = v0 + half[i, 1] * ((2 * b + 1) / taps - 1)
                x, y = int(np.floor((u - camera[U0]) / camera[DU])), int(np.floor((v - camera[V0]) / camera[DV]))
                if not (0 <= x < depth.shape[1] and 0 <= y < depth.shape[0]):
                    continue
                cu, cv = camera[U0] + (x + 0.5) * camera[DU], camera[V0] + (y + 0.5) * camera[DV]
                if depth[y, x] + bias < _plane_depth(points[i], normals[i], s, cu, cv):
                    blocked += 1
                    total += depth[y, x]
        if search:
            out[i] = total / blocked if blocked else 0.0
        else:
            out[i] = blocked / (taps * taps)


def filtered_maps(
    world: World,
    emitters: Sequence[Emitter],
    points: Sequence[F64],
    resolution: int,
    near: float,
    counters: Counter[str],
    *,
    central: bool,
    prefilter: Prefilter | None = None,
) -> list[FilteredMaps]:
    """Maps of every emitter from all its light points, or (central) from its centre alone."""
    return [
        FilteredMaps(world, e, e.centre[None] if central else p, p, resolution, near, counters, prefilter)
        for e, p in zip(emitters, points, strict=True)
    ]
