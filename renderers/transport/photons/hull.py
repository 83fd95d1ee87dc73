"""Area sampled by scattered points: convex hull, and the hull corrected for what it misses.

A convex hull underestimates the convex region its points were drawn from. Efron (1965): the expected missing share of area equals
the expected share of points that are hull vertices. Hence the estimator of Baldin & Reiß (2016) for an unknown convex region

    A = A_H (n + 1) / (n - v + 1)          n points, v of them vertices of the hull

right in the mean for discs, half discs and corners alike; a disc πr² is too large wherever the region ends inside it.
"""

from __future__ import annotations

import numba
import numpy as np

DISC, HULL, CORRECTED = 0, 1, 2
DIRECTIONS = 16


@numba.njit(nogil=True, cache=True)
def hull_area(x, y, count):  # type: ignore[no-untyped-def]
    """(area, vertices) of the convex hull of points x, y float64 (≥ count,); area 0 for collinear, coincident or < 3 points.

    Points inside the polygon of the extremes in 16 directions can't be vertices and are dropped first (Akl & Toussaint 1978);
    the others go through Andrew's monotone chain (1979).
    """
    if count < 3:
        return 0.0, count
    px, py = _outer(x, y, count)
    m = len(px)
    if m < 3:
        return 0.0, m
    order = np.argsort(py, kind="mergesort")
    order = order[np.argsort(px[order], kind="mergesort")]
    chain = np.empty(2 * m + 1, np.int64)
    size = 0
    for step in range(2):
        start = size
        for j in range(m):
            i = order[j] if step == 0 else order[m - 1 - j]
            while size >= start + 2 and _turn(px, py, chain[size - 2], chain[size - 1], i) <= 0.0:
                size -= 1
            chain[size] = i
            size += 1
        size -= 1
    area = 0.0
    for j in range(size):
        a, b = chain[j], chain[(j + 1) % size]
        area += px[a] * py[b] - px[b] * py[a]
    return max(0.0, area / 2), size


@numba.njit(inline="always")
def _turn(x, y, a, b, c):  # type: ignore[no-untyped-def]
    return (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])


@numba.njit(nogil=True, cache=True)
def _outer(x, y, count):  # type: ignore[no-untyped-def]
    """Points not strictly inside the polygon of the extremes (all of them for few points)."""
    if count <= 2 * DIRECTIONS:
        return x[:count].copy(), y[:count].copy()
    extreme = np.zeros(DIRECTIONS, np.int64)
    for d in range(DIRECTIONS):
        c, s = np.cos(2 * np.pi * d / DIRECTIONS), np.sin(2 * np.pi * d / DIRECTIONS)
        best = -np.inf
        for i in range(count):
            reach = c * x[i] + s * y[i]
            if reach > best:
                best, extreme[d] = reach, i
    ox, oy = np.empty(count), np.empty(count)
    kept = 0
    for i in range(count):
        inside = True
        for d in range(DIRECTIONS):
            a, b = extreme[d], extreme[(d + 1) % DIRECTIONS]
            if a != b and (x[b] - x[a]) * (y[i] - y[a]) - (y[b] - y[a]) * (x[i] - x[a]) <= 0.0:
                inside = False
                break
        if not inside:
            ox[kept], oy[kept] = x[i], y[i]
            kept += 1
    if kept == 0:  # all points coincide
        return x[:1].copy(), y[:1].copy()
    return ox[:kept].copy(), oy[:kept].copy()


@numba.njit(nogil=True, cache=True)
def area_and_vertices(x, y, count, radius, estimator):  # type: ignore[no-untyped-def]
    """(area, hull vertices): area from which `count` points within `radius` were drawn, by one of DISC, HULL, CORRECTED.

    The disc stands in where a hull says nothing: fewer than 3 points, or all on a line. The corrected area isn't capped by it: its
    mean is right because it errs to both sides. The disc estimator looks for no hull, and answers 0 vertices.
    """
    disc = np.pi * radius * radius
    if estimator == DISC or count < 3:
        return disc, 0
    area, vertices = hull_area(x, y, count)
    if area <= 1e-9 * disc:
        return disc, vertices
    if estimator == HULL:
        return area, vertices
    return area * (count + 1) / (count - vertices + 1), vertices


@numba.njit(nogil=True, cache=True)
def sampled_area(x, y, count, radius, estimator):  # type: ignore[no-untyped-def]
    """The area of `area_and_vertices`."""
    return area_and_vertices(x, y, count, radius, estimator)[0]
