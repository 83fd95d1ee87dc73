"""Scene T1 in light space, by analytic intersections: floor, sphere, box, capsule and a second box under a square light at Z = 0.

An oracle apart from the rasteriser and the walks: shadow maps, the average of shadow tests, and the true hidden share.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.assemble import Construction, MapMaker, assemble
from renderers.transport.penumbra.cameras import DU, DV, U0, V0, S, cameras_of
from renderers.transport.penumbra.emitters import stratified
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.pyramid import Pyramid
from renderers.transport.penumbra.walk import bounds_of, row_events

F64 = NDArray[np.float64]
Surface = Callable[[F64, F64], F64]
EPS = 1e-9


def plane(z0: float, k: float = 0.0, l: float = 0.0) -> Surface:  # noqa: E741
    """Z = z0 + kX + lY; a Surface gives the smallest t > 0 of rays o + t d, inf for a miss."""

    def hit(o: F64, d: F64) -> F64:
        n = np.array([-k, -l, 1.0])
        t = (z0 - o @ n) / (d @ n)
        return np.where(t > EPS, t, np.inf)

    return hit


def sphere(centre: tuple[float, float, float], radius: float) -> Surface:
    """A sphere."""

    def hit(o: F64, d: F64) -> F64:
        m = o - np.array(centre)
        a, b, c = (d * d).sum(-1), (m * d).sum(-1), (m * m).sum(-1) - radius**2
        root = b * b - a * c
        with np.errstate(invalid="ignore"):
            first, second = (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a
        t = np.where(first > EPS, first, second)
        return np.where((root >= 0) & (t > EPS), t, np.inf)

    return hit


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Surface:
    """An axis-aligned box."""

    def hit(o: F64, d: F64) -> F64:
        safe = np.where(np.abs(d) < 1e-15, 1e-15, d)
        a, b = (np.array(low) - o) / safe, (np.array(high) - o) / safe
        enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
        t = np.where(enter > EPS, enter, leave)
        return np.where((enter <= leave) & (t > EPS), t, np.inf)

    return hit


def capsule(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Surface:
    """Cylinder with round ends; rays start outside."""
    a, axis = np.array(start), np.array(end) - np.array(start)
    length2 = float(axis @ axis)
    ends = sphere(start, radius), sphere(end, radius)

    def hit(o: F64, d: F64) -> F64:
        m = o - a
        md, nd, dd = m @ axis, d @ axis, (d * d).sum(-1)
        p = length2 * dd - nd * nd
        q = length2 * (m * d).sum(-1) - nd * md
        r = length2 * ((m * m).sum(-1) - radius**2) - md * md
        root = q * q - p * r
        with np.errstate(invalid="ignore", divide="ignore"):
            t = (-q - np.sqrt(root)) / p
            along = (md + t * nd) / length2
            body = np.where((root >= 0) & (p > 1e-15) & (t > EPS) & (along >= 0) & (along <= 1), t, np.inf)
        return np.minimum(body, np.minimum(ends[0](o, d), ends[1](o, d)))

    return hit


FLOOR = plane(10.0, 0.2)
BLOCKERS: tuple[Surface, ...] = (
    sphere((0.3, -0.2, 6.0), 1.0),
    box((-2.5, -0.8, 7.5), (-1.2, 0.8, 8.3)),
    capsule((-1.5, 1.5, 5.0), (1.5, 1.7, 7.0), 0.05),
    box((1.3, -2.0, 8.6), (2.2, -1.1, 9.9)),
)
NEAR, FAR, HALF = 3.0, 16.0, 0.5
BIAS = 0.02


def view(resolution: int, near: float = NEAR, far: float = FAR) -> Pyramid:
    """The pyramid of T1 at the light's centre."""
    return Pyramid(np.zeros(3), np.eye(3), (-HALF, -HALF), 2 * HALF / resolution, resolution, resolution, near, far)


def light_points(count: int, half: float = 1.0, seed: int = 1) -> F64:
    """Stratified points (count, 3) on a square light of half side `half`."""
    flat = (stratified(count, np.random.default_rng(seed)) * 2 - 1) * half
    return np.concatenate([flat, np.zeros((count, 1))], axis=1)


def nearest_hit(surfaces: tuple[Surface, ...], o: F64, d: F64) -> F64:
    """Smallest t over all surfaces."""
    t = np.full(np.broadcast_shapes(o.shape, d.shape)[:-1], np.inf)
    for surface in surfaces:
        t = np.minimum(t, surface(o, d))
    return t


def depth_of(surfaces: tuple[Surface, ...], cameras: F64, resolution: int) -> NDArray[np.float32]:
    """Shadow maps (N, resolution, resolution) by ray casting at texel centres."""
    maps = np.empty((len(cameras), resolution, resolution), np.float32)
    centres = np.arange(resolution) + 0.5
    for camera, out in zip(cameras, maps, strict=True):
        u, v = np.meshgrid(camera[U0] + centres * camera[DU], camera[V0] + centres * camera[DV])
        out[:] = nearest_hit(surfaces, camera[S : S + 3], np.stack([u, v, np.ones_like(u)], axis=-1) @ camera[:9].reshape(3, 3))
    return maps


def average_of_tests(cameras: F64, maps: NDArray[np.float32], points: F64, bias: float) -> F64:
    """Share of shadow maps (nearest texel, D + bias < depth) that hide points (P, 3); outside a map is lit."""
    total = np.zeros(len(points))
    for camera, depth in zip(cameras, maps, strict=True):
        c = (points - camera[S : S + 3]) @ camera[:9].reshape(3, 3).T
        x = np.floor((c[:, 0] / c[:, 2] - camera[U0]) / camera[DU]).astype(int)
        y = np.floor((c[:, 1] / c[:, 2] - camera[V0]) / camera[DV]).astype(int)
        inside = (x >= 0) & (y >= 0) & (x < depth.shape[1]) & (y < depth.shape[0])
        stored = np.full(len(points), np.inf)
        stored[inside] = depth[y[inside], x[inside]]
        total += stored + bias < c[:, 2]
    return total / len(cameras)


def hidden_share(surfaces: tuple[Surface, ...], points: F64, grid: int = 48, half: float = 1.0) -> F64:
    """The true V at points (P, 3): share of grid² regular light points that the surfaces hide."""
    steps = ((np.arange(grid) + 0.5) / grid * 2 - 1) * half
    blocked = np.zeros(len(points))
    for x in steps:
        for y in steps:
            blocked += nearest_hit(surfaces, points, np.array([x, y, 0.0]) - points) < 1
    return blocked / grid**2


def floor_points(count: int) -> F64:
    """count² regular points of T1's floor inside the pyramid, (P, 3)."""
    side = np.linspace(-4, 4, count)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    z = 10 + 0.2 * x
    keep = (np.abs(x / z) < 0.495) & (np.abs(y / z) < 0.495)
    return np.stack([x, y, z], axis=1)[keep]


def constructed(
    surfaces: tuple[Surface, ...],
    points: F64,
    resolution: int,
    map_resolution: int,
    how: Construction,
    pyramid: Pyramid | None = None,
) -> tuple[PenumbraMap, F64, NDArray[np.float32]]:
    """The penumbra map of T1 (or another pyramid) from analytic shadow maps, with its cameras and maps."""
    pyramid = view(resolution) if pyramid is None else pyramid
    cameras = cameras_of(pyramid, points, map_resolution)
    maps = depth_of(surfaces, cameras, map_resolution)
    return assemble(pyramid, cameras, ready(cameras, maps), how), cameras, maps


def ready(cameras: F64, maps: NDArray[np.float32]) -> MapMaker:
    """Maps (N, h, w) of cameras (N, CAMERA) that are there already."""
    index = {camera.tobytes(): k for k, camera in enumerate(cameras)}

    def draw(part: F64, top: NDArray[np.int64], out: NDArray[np.float32], spare: NDArray[np.float32]) -> None:
        for camera, first, band in zip(part, top, out, strict=True):
            there = maps[index[camera.tobytes()], first : first + len(band)]
            band.fill(np.inf)
            band[: len(there)] = there

    return MapMaker((maps.shape[1], maps.shape[2]), draw)


def events_of_rays(
    maps: NDArray[np.float32], cameras: F64, us: F64, vs: F64, near: float, far: float, bias: float, exact: bool
) -> tuple[NDArray[np.float32], NDArray[np.int8], int]:
    """Depths and signs of all events, and the steps walked."""
    room = (np.empty(1 << 20, np.int32), np.empty(1 << 20, np.float32), np.empty(1 << 20, np.int8))
    top = np.zeros(len(maps), np.int64)
    count, steps = row_events(maps, *bounds_of(maps), cameras, top, us, vs, near, far, bias, exact, *room)
    assert count >= 0
    return room[1][:count], room[2][:count], steps


def on_rays(pyramid: Pyramid, count: int, seed: int) -> F64:
    """Random points (count, 3) on rays through pixel centres."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(pyramid.near, pyramid.far, count)
    u, v = rng.choice(pyramid.us, count), rng.choice(pyramid.vs, count)
    return np.stack([u * z, v * z, z], axis=1)
