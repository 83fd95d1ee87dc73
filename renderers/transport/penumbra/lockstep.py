"""All rays of a pyramid's row through one shadow map in step: the exact walk where the map's grid fits that of the pyramid.

A flat light in the plane of the apex has cameras parallel to the pyramid. All rays then have one displacement in the map,

    x(q) = (u - s_x q - u_0) / Δu,        q = 1 / Z,

and where Δu divides the pixels' pitch (or is a multiple of it: every r-th pixel) they have one fraction of a texel at every q.
They cross texel edges at the same depths, and each step is one comparison over a contiguous piece of a map's row: 64 texels at a
time instead of one. A light whose points lie in front of the plane, or turned cameras, need the general `walk`.

Texels get the pitch Δ = pitch / m or r · pitch, at least as fine as asked. With q = 0 rays pass through texel centres, so a point
light's maps are the pyramid's own pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.transport.penumbra.cameras import CAMERA, DU, DV, RANK, U0, V0, S, ranks
from renderers.transport.penumbra.pyramid import Pyramid

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
LANES = 64


class Grid(NamedTuple):
    """How maps fit the pyramid's pixels: `fine` texels a pixel, or `coarse` pixels a texel (one of them is 1).

    shape: rows and columns of every map; columns divide into `fine` interleaved ones.
    """

    fine: int
    coarse: int
    shape: tuple[int, int]


def aligned_cameras(pyramid: Pyramid, points: ArrayLike, resolution: int) -> tuple[F64, Grid] | None:
    """Cameras (N, CAMERA) at `points` (N, 3) in the plane of the apex, pyramid's frame, whose texels fit the pixels, and the Grid.

    resolution: texels across the widest window, at least. None where a point lies off the plane.
    """
    s = np.asarray(points, np.float64).reshape(-1, 3)
    if np.abs(s[:, 2]).max(initial=0) > 1e-9 * pyramid.far:
        return None
    shift = np.stack([s[:, :2] / pyramid.near, s[:, :2] / pyramid.far])
    low = np.array(pyramid.low) - shift.max(axis=0)
    high = np.array(pyramid.low) + pyramid.pitch * np.array([pyramid.width, pyramid.height]) - shift.min(axis=0)
    asked = float((high - low).max()) / (resolution - 2)
    coarse = max(int(pyramid.pitch and asked / pyramid.pitch * (1 + 1e-9)), 1)
    fine = 1 if coarse > 1 else max(int(np.ceil(pyramid.pitch / asked * (1 - 1e-9))), 1)
    pitch = pyramid.pitch * coarse / fine
    # even numbers of texels a pixel have no middle one: half a texel moves the pixel's centre to a texel's
    half = 0.5 if fine % 2 == 0 else 0.0
    before = np.ceil((np.array(pyramid.low) - low) / pitch) + 1 + half
    start = np.array(pyramid.low) - before * pitch
    rows, columns = (int(np.ceil(((high - start) / pitch)[:, axis].max())) + 2 for axis in (1, 0))
    columns = -(-(columns + LANES * fine) // fine) * fine
    cameras = np.zeros((len(s), CAMERA))
    cameras[:, :9] = np.eye(3).ravel()
    cameras[:, S : S + 3] = s
    cameras[:, [U0, V0]] = start
    cameras[:, [DU, DV]] = pitch
    cameras[:, RANK] = ranks(len(s))
    return cameras, Grid(fine, coarse, (rows, columns))


def interleaved(maps: F32, grid: Grid) -> F32:
    """Maps (N, h, w) as (N, h, fine, w / fine), a view: there, texels of neighbouring pixels are neighbours."""
    n, h, w = maps.shape
    return maps.reshape(n, h, w // grid.fine, grid.fine).transpose(0, 1, 3, 2)


@numba.njit(nogil=True, cache=True)
def tile_events(maps, cameras, top, us, vs, near, far, bias, coarse, pixel, z, sign):  # type: ignore[no-untyped-def]
    """Events of a few rows of the pyramid in all maps: fills pixel int32 (row · W + column), z float32, sign int8 and returns how
    many there are, -1 if they don't fit; and the steps walked.

    maps float32 (N, h, m, w / m), `interleaved`; cameras float64 (N, CAMERA) of one Grid; top int64 (N,): rows of each window above
    its map; us (W,), vs (rows,): tangents of the pixel centres; near, far, bias: World units; coarse: pixels a texel.
    """
    columns = len(us)
    lanes = -(-columns // coarse) + LANES
    state, changed = np.zeros(lanes, np.int32), np.zeros(LANES, np.int32)
    count, walked = 0, 0
    for i in range(len(maps)):
        for row in range(len(vs)):
            for phase in range(min(coarse, columns)):
                rays = (columns - phase + coarse - 1) // coarse
                state[:] = 0
                ray = _shared(cameras[i], us[phase], vs[row], near, far)
                ax, bx, ay, by, q, q_out = ray
                ix, iy = int(np.floor(ax + bx * q)), int(np.floor(ay + by * q))
                step_x, step_y = (-1 if bx > 0 else 1), (-1 if by > 0 else 1)
                edge_x, edge_y = (0 if bx > 0 else 1), (0 if by > 0 else 1)
                while True:
                    qx = (ix + edge_x - ax) / bx if bx != 0 else -np.inf
                    qy = (iy + edge_y - ay) / by if by != 0 else -np.inf
                    q_next = min(max(qx, qy, q_out), q)
                    if count + 2 * rays > len(pixel):
                        return -1, walked
                    fine = maps.shape[2]
                    line = maps[i, iy - top[i], ix % fine][ix // fine :]
                    here = (row * columns + phase, coarse, rays)
                    count = _step(line, state, changed, here, min(1 / q, far), min(1 / q_next, far), bias, pixel, z, sign, count)
                    walked += rays
                    if q_next <= q_out:
                        break
                    if qx >= qy:
                        ix += step_x
                    if qy >= qx:
                        iy += step_y
                    q = q_next
    return count, walked


@numba.njit(inline="always")
def _shared(camera, u, v, near, far):  # type: ignore[no-untyped-def]
    """(a_x, b_x, a_y, b_y, q_in, q_out) of the ray with tangents (u, v): texel coordinates are a + b q."""
    return (
        (u - camera[U0]) / camera[DU], -camera[S] / camera[DU], (v - camera[V0]) / camera[DV], -camera[S + 1] / camera[DV],
        1.0 / near, 1.0 / far,
    )  # fmt: skip


@numba.njit(nogil=True)
def _step(line, state, changed, here, z_in, z_out, bias, pixel, z, sign, count):  # type: ignore[no-untyped-def]
    """One texel of every ray: span z_in … z_out of the depths line[j] + bias; returns the new number of events.

    A block of lanes without a change costs two comparisons a lane and no branch.
    """
    first, every, rays = here
    whole, part = np.float32(z_in - bias), np.float32(z_out - bias)
    for start in range(0, rays, LANES):
        any_change = np.int32(0)
        block, held = line[start : start + LANES], state[start : start + LANES]
        for j in range(LANES):
            d, shadowed = block[j], held[j]
            change = (np.int32(d <= whole) ^ shadowed) | (np.int32(d < part) ^ shadowed)
            changed[j] = change
            any_change |= change
        if any_change == 0:
            continue
        for j in range(LANES):
            if changed[j] == 0:
                continue
            ray = start + j
            d, shadowed = line[ray], state[ray]
            state[ray] = np.int32(d < part)
            # lanes beyond the last ray only follow their texels
            if ray >= rays:
                continue
            if (d <= whole) != (shadowed == 1):
                pixel[count], z[count], sign[count] = first + ray * every, z_in, 1 - 2 * shadowed
                count += 1
            if whole < d and d < part:
                pixel[count], z[count], sign[count] = first + ray * every, min(max(d + bias, z_in), z_out), 1
                count += 1
    return count
