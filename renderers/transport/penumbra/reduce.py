"""Events of a pixel to its attenuation function (numba kernels).

Events are sorted by depth; all that lie within `merge` of the first of a group change V at once, at the last depth of the group (an
exit and an entry at one depth never leave [0, 1] in between). V is the running sum over N, then compressed.
"""

from __future__ import annotations

import numba
import numpy as np

from renderers.transport.penumbra.compress import compress, fitted


@numba.njit(nogil=True, cache=True)
def compress_row(start, depth, value, method, epsilon, scale, budget):  # type: ignore[no-untyped-def]
    """Counts int64 (pixels,), depth, value float32 (M,) of compressed functions; start (pixels + 1,) of uncompressed ones."""
    pixels = len(start) - 1
    counts = np.zeros(pixels, np.int64)
    longest = (start[1:] - start[:-1]).max() + 3
    out_depth, out_value = np.empty(start[-1] - start[0] + 1, np.float32), np.empty(start[-1] - start[0] + 1, np.float32)
    step_z, step_v, out_z, out_v = np.empty(longest), np.empty(longest), np.empty(longest), np.empty(longest)
    total = 0
    for p in range(pixels):
        n = 0
        for k in range(start[p], start[p + 1]):
            if n == 0:
                # the leading (z, 0) that `compress` leaves out
                step_z[0], step_v[0], n = depth[k], 0.0, 1
            step_z[n], step_v[n] = depth[k], value[k]
            n += 1
        m = compress(step_z, step_v, n, method, epsilon, scale, out_z, out_v)
        if budget > 0 and m > budget:
            m = fitted(step_z, step_v, n, method, epsilon, scale, budget, out_z, out_v)
        for k in range(m):
            out_depth[total + k], out_value[total + k] = out_z[k], out_v[k]
        counts[p] = m
        total += m
    return counts, out_depth[:total].copy(), out_value[:total].copy()


@numba.njit(nogil=True, cache=True)
def count_events(pixel, counts):  # type: ignore[no-untyped-def]
    """Add to counts int64 (pixels,) the number of events (E,) of each pixel."""
    for p in pixel:
        counts[p] += 1


@numba.njit(nogil=True, cache=True)
def sorted_keys(pixel, z, sign, first, place, keys):  # type: ignore[no-untyped-def]
    """Put events (E,) of the pixels from `first` on to the others of their pixel: place int64 (pixels,) is where each pixel's next
    one goes in keys uint32. Those of other pixels are left out.

    An event is one integer: the bits of a positive float rise with it, and its sign fills the freed bit.
    """
    bits = z.view(np.uint32)
    for k in range(len(z)):
        p = pixel[k] - first
        if 0 <= p < len(place):
            keys[place[p]] = (bits[k] << np.uint32(1)) | np.uint32(sign[k] > 0)
            place[p] += 1


@numba.njit(nogil=True, cache=True)
def functions(start, keys, first, samples, merge, method, epsilon, scale, budget, counts, depth, value):  # type: ignore[no-untyped-def]
    """Packed functions of the pixels from `first` on, as many as fit into depth, value float32 (at least one does): fills counts
    int64 (pixels,); returns the first pixel that is left and the number of vertices.

    start (pixels + 1,): where each pixel's events are in keys uint32 (`sorted_keys`), in any order.
    """
    pixels = len(start) - 1
    longest = (start[1:] - start[:-1]).max()
    step_z, step_v = np.empty(2 * longest + 2), np.empty(2 * longest + 2)
    out_z, out_v = np.empty(2 * longest + 4), np.empty(2 * longest + 4)
    total = 0
    for p in range(first, pixels):
        own = keys[start[p] : start[p + 1]]
        own.sort()
        n = accumulate(own, samples, merge, step_z, step_v)
        m = compress(step_z, step_v, n, method, epsilon, scale, out_z, out_v)
        if budget > 0 and m > budget:
            m = fitted(step_z, step_v, n, method, epsilon, scale, budget, out_z, out_v)
        if total + m > len(depth):
            return p, total
        for k in range(m):
            depth[total + k], value[total + k] = out_z[k], out_v[k]
        counts[p] = m
        total += m
    return pixels, total


@numba.njit(nogil=True, cache=True)
def accumulate(keys, samples, merge, step_z, step_v):  # type: ignore[no-untyped-def]
    """Step form of one pixel's sorted events: fills step_z, step_v (two points a change), returns the number of points."""
    depths = (keys >> np.uint32(1)).view(np.float32)
    n, inside, k = 0, 0, 0
    while k < len(keys):
        first, before = depths[k], inside
        last = first
        while k < len(keys) and depths[k] - first <= merge:
            last = depths[k]
            inside += 1 if keys[k] & np.uint32(1) else -1
            k += 1
        if inside != before:
            step_z[n], step_v[n] = last, before / samples
            step_z[n + 1], step_v[n + 1] = last, inside / samples
            n += 2
    return n
