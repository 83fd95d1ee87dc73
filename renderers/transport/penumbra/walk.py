"""A ray of the pyramid through one shadow map: where it enters shadow (+1) and where it leaves it (-1).

The ray P(Z) = Z (u, v, 1) has camera coordinates c = αZ - β with α = R (u, v, 1), β = R s. With q = 1 / c_z the map's texel
coordinates are affine,

    x(q) = (A + B q - u_0) / Δu,    A = α_x / α_z,    B = A β_z - β_x,        (same for y)

so the ray is a straight line in the map; q falls while Z = (1/q + β_z) / α_z grows. Cameras parallel to the pyramid in one plane
with its apex have α_z = 1, β_z = 0: then Z = 1/q is the depth in every map. Turned cameras and points in front of that plane need
nothing else.

Exact (St-Amour 2004 §3.1 made exact): every texel that the line touches counts. On its span of the ray the map is constant, so the
shadowed part is known exactly, and the events add up to the shadow test D + b < Z everywhere. Blocks of texels whose depths are all
before or all behind the ray's span are passed in one step. Midpoint: the published scan
conversion, one texel per step of the major axis; the stored depth where the step brackets it, the step's own depth elsewhere.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.penumbra.cameras import DU, DV, U0, V0, S

NOTHING = np.float32(np.inf)
# texels along a block's side
BLOCK = 8
# a camera plane cuts the ray nearer than this: what lies behind the camera is lit
IN_FRONT = 1e-6


@numba.njit(inline="always")
def project(camera, u, v, near, far):  # type: ignore[no-untyped-def]
    """(seen, a_x, b_x, a_y, b_y, 1/α_z, β_z, q_in, q_out) of the ray with tangents (u, v) between depths near and far."""
    ax = camera[0] * u + camera[1] * v + camera[2]
    ay = camera[3] * u + camera[4] * v + camera[5]
    az = camera[6] * u + camera[7] * v + camera[8]
    sx, sy, sz = camera[S], camera[S + 1], camera[S + 2]
    bx = camera[0] * sx + camera[1] * sy + camera[2] * sz
    by = camera[3] * sx + camera[4] * sy + camera[5] * sz
    bz = camera[6] * sx + camera[7] * sy + camera[8] * sz
    seen = az > 0 and az * far - bz > IN_FRONT
    if not seen:
        return seen, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    first, last = max(az * near - bz, IN_FRONT), az * far - bz
    px, py = ax / az, ay / az
    return (
        seen,
        (px - camera[U0]) / camera[DU], (px * bz - bx) / camera[DU],
        (py - camera[V0]) / camera[DV], (py * bz - by) / camera[DV],
        1.0 / az, bz, 1.0 / first, 1.0 / max(last, first),
    )  # fmt: skip


@numba.njit(inline="always")
def texel(depth, ix, iy):  # type: ignore[no-untyped-def]
    """Stored depth of a row and column of the map; outside of it nothing blocks."""
    if 0 <= iy < depth.shape[0] and 0 <= ix < depth.shape[1]:
        return depth[iy, ix]
    return NOTHING


@numba.njit(parallel=True, cache=True)
def bounds_of(maps):  # type: ignore[no-untyped-def]
    """Least and greatest depth of the blocks of maps (N, h, w): two float32 (N, ⌈h / BLOCK⌉, ⌈w / BLOCK⌉)."""
    n, h, w = maps.shape
    low = np.full((n, -(-h // BLOCK), -(-w // BLOCK)), NOTHING)
    # what lies beyond the map is lit
    high = np.full(low.shape, NOTHING)
    for i in numba.prange(n):
        for by in range(low.shape[1]):
            for bx in range(low.shape[2]):
                least, most = NOTHING, np.float32(0)
                for y in range(by * BLOCK, min((by + 1) * BLOCK, h)):
                    for x in range(bx * BLOCK, min((bx + 1) * BLOCK, w)):
                        least, most = min(least, maps[i, y, x]), max(most, maps[i, y, x])
                low[i, by, bx] = least
                if (by + 1) * BLOCK <= h and (bx + 1) * BLOCK <= w:
                    high[i, by, bx] = most
    return low, high


@numba.njit(nogil=True, cache=True)
def walk_exact(depth, low, high, top, ray, near, far, bias, z, sign, count):  # type: ignore[no-untyped-def]
    """Append events of one ray to z, sign from `count` on; returns the new count.

    ray: what `project` returned; low, high: the map's `bounds_of`; top: rows of the window above the map, whole blocks.
    """
    _, ax, bx, ay, by, iaz, bz, q, q_out = ray
    cx, cy = int(np.floor((ax + bx * q) / BLOCK)), int(np.floor((ay + by * q) / BLOCK))
    step_x, step_y = (-1 if bx > 0 else 1), (-1 if by > 0 else 1)
    edge_x, edge_y = (0 if bx > 0 else 1), (0 if by > 0 else 1)
    inverse_x, inverse_y = (1 / bx if bx != 0 else 0.0), (1 / by if by != 0 else 0.0)
    shadowed = False
    while True:
        qx = ((cx + edge_x) * BLOCK - ax) * inverse_x if bx != 0 else -np.inf
        qy = ((cy + edge_y) * BLOCK - ay) * inverse_y if by != 0 else -np.inf
        q_next = min(max(qx, qy, q_out), q)
        block = cy - top // BLOCK
        inside = 0 <= block < low.shape[0] and 0 <= cx < low.shape[1]
        if not inside or (low[block, cx] + bias) * q_next >= 1:
            if shadowed:
                z[count], sign[count] = _depth_at(q, bz, iaz, near, far), -1
                count += 1
            shadowed = False
        elif (high[block, cx] + bias) * q <= 1:
            if not shadowed:
                z[count], sign[count] = _depth_at(q, bz, iaz, near, far), 1
                count += 1
            shadowed = True
        else:
            count, shadowed = _walk_block(depth, top, cx, cy, ray, q, q_next, near, far, bias, z, sign, count, shadowed)
        if q_next <= q_out:
            return count
        if qx >= qy:
            cx += step_x
        if qy >= qx:
            cy += step_y
        q = q_next


@numba.njit(nogil=True)
def _walk_block(depth, top, cx, cy, ray, q, q_out, near, far, bias, z, sign, count, shadowed):  # type: ignore[no-untyped-def]
    """The same texel by texel, from q to q_out, within one block."""
    _, ax, bx, ay, by, iaz, bz, _, _ = ray
    # rounding at a block's edge may name the texel beyond it
    ix = min(max(int(np.floor(ax + bx * q)), cx * BLOCK), (cx + 1) * BLOCK - 1)
    iy = min(max(int(np.floor(ay + by * q)), cy * BLOCK), (cy + 1) * BLOCK - 1)
    step_x, step_y = (-1 if bx > 0 else 1), (-1 if by > 0 else 1)
    edge_x, edge_y = (0 if bx > 0 else 1), (0 if by > 0 else 1)
    inverse_x, inverse_y = (1 / bx if bx != 0 else 0.0), (1 / by if by != 0 else 0.0)
    while True:
        qx = (ix + edge_x - ax) * inverse_x if bx != 0 else -np.inf
        qy = (iy + edge_y - ay) * inverse_y if by != 0 else -np.inf
        q_next = min(max(qx, qy, q_out), q)
        d = texel(depth, ix, iy - top) + bias
        # the span's camera depths are 1/q … 1/q_next; products spare a division per texel
        if d * q > 1 and d * q_next < 1:
            if shadowed:
                z[count], sign[count] = _depth_at(q, bz, iaz, near, far), -1
                count += 1
            z[count], sign[count] = min(max((d + bz) * iaz, near), far), 1
            count += 1
            shadowed = True
        elif (d * q <= 1) != shadowed:
            shadowed = not shadowed
            z[count], sign[count] = _depth_at(q, bz, iaz, near, far), (1 if shadowed else -1)
            count += 1
        if q_next <= q_out:
            return count, shadowed
        if qx >= qy:
            ix += step_x
        if qy >= qx:
            iy += step_y
        q = q_next


@numba.njit(inline="always")
def _depth_at(q, bz, iaz, near, far):  # type: ignore[no-untyped-def]
    """Depth of the ray at parameter q."""
    return min(max((1 / q + bz) * iaz, near), far)


@numba.njit(nogil=True, cache=True)
def walk_midpoint(depth, top, ray, near, far, bias, z, sign, count):  # type: ignore[no-untyped-def]
    """The published walk (St-Amour 2004 §3.1, figure 3.4): as `walk_exact`, one texel per step of the major axis."""
    _, ax, bx, ay, by, iaz, bz, q_in, q_out = ray
    x0, y0 = int(np.floor(ax + bx * q_in)), int(np.floor(ay + by * q_in))
    x1, y1 = int(np.floor(ax + bx * q_out)), int(np.floor(ay + by * q_out))
    steps = max(abs(x1 - x0), abs(y1 - y0))
    if steps == 0:
        d = (texel(depth, x0, y0 - top) + bias + bz) * iaz
        if d < far:
            z[count], sign[count] = max(d, near), 1
            count += 1
        return count
    shadowed, before = False, near
    for k in range(steps + 1):
        ix, iy = int(np.floor(x0 + (x1 - x0) * k / steps + 0.5)), int(np.floor(y0 + (y1 - y0) * k / steps + 0.5))
        here = max((1 / (q_in + k / steps * (q_out - q_in)) + bz) * iaz, near)
        d = (texel(depth, ix, iy - top) + bias + bz) * iaz
        if d < here and not shadowed:
            z[count], sign[count] = (d if before <= d else here), 1
            count += 1
            shadowed = True
        elif d >= here and shadowed:
            z[count], sign[count] = before, -1
            count += 1
            shadowed = False
        before = here
    return count


@numba.njit(nogil=True, cache=True)
def row_events(maps, low, high, cameras, top, us, vs, near, far, bias, exact, pixel, z, sign):  # type: ignore[no-untyped-def]
    """Events of a few rows of the pyramid in all maps: fills pixel int32 (row · W + column), z float32, sign int8 and returns how
    many there are, -1 if they may not fit; and the steps walked.

    maps float32 (N, h, w) with their `bounds_of`; cameras float64 (N, CAMERA); top int64 (N,): rows of each window above its map,
    whole blocks; us float64 (W,), vs (rows,): tangents of the pixel centres; near, far, bias: world units.
    """
    count, walked = 0, 0
    for i in range(len(maps)):
        for row in range(len(vs)):
            for column in range(len(us)):
                seen, ax, bx, ay, by, iaz, bz, q_in, q_out = project(cameras[i], us[column], vs[row], near, far)
                if not seen:
                    continue
                dx = abs(int(np.floor(ax + bx * q_out)) - int(np.floor(ax + bx * q_in)))
                dy = abs(int(np.floor(ay + by * q_out)) - int(np.floor(ay + by * q_in)))
                # a texel gives at most two events; rounding may add one texel in x and in y for each block
                if count + 3 * (dx + dy + 8) > len(pixel):
                    return -1, walked
                ray = (seen, ax, bx, ay, by, iaz, bz, q_in, q_out)
                first = count
                if exact:
                    count = walk_exact(maps[i], low[i], high[i], top[i], ray, near, far, bias, z, sign, count)
                    walked += dx + dy + 1
                else:
                    count = walk_midpoint(maps[i], top[i], ray, near, far, bias, z, sign, count)
                    walked += max(dx, dy) + 1
                pixel[first:count] = row * len(us) + column
    return count, walked
