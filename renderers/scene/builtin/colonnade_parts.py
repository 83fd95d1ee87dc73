"""Parts of the colonnade. Segment counts scale with `detail` (1 is about 200,000 triangles in all), down to what keeps a shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.builtin.solids import box, flipped, grid, lathe, merge, patch, tube
from renderers.scene.shapes import Shape

F64 = NDArray[np.float64]
Point = tuple[float, float, float]
SPRING, OPENING = 3.4, 1.6


def count(base: float, detail: float, least: int) -> int:
    """Number of segments."""
    return max(least, round(base * detail))


def floor(low: tuple[float, float], high: tuple[float, float], cell: float) -> Shape:
    """Horizontal rectangle at y = 0 between (x, z) corners, facing up, in cells of about `cell`."""
    (x0, z0), (x1, z1) = low, high
    rows, columns = max(1, round((z1 - z0) / cell)), max(1, round((x1 - x0) / cell))
    return patch([(x0, 0, z0), (x0, 0, z1), (x1, 0, z1), (x1, 0, z0)], rows, columns)


def tiles(low: tuple[float, float], high: tuple[float, float], cells: tuple[int, int], parity: int, cell: float) -> Shape:
    """Every second tile of a chequered floor."""
    x, z = np.linspace(low[0], high[0], cells[0] + 1), np.linspace(low[1], high[1], cells[1] + 1)
    chosen = [(i, k) for i in range(cells[0]) for k in range(cells[1]) if (i + k) % 2 == parity]
    return merge(*(floor((float(x[i]), float(z[k])), (float(x[i + 1]), float(z[k + 1])), cell) for i, k in chosen))


def slab(low: Point, high: Point, cell: float) -> Shape:
    """Box cut into cells."""
    return box(low, high, cell)


def wall(start: Point, end: Point, height: float, cell: float) -> Shape:
    """Vertical rectangle over the foot start..end; its front faces (end - start) × up."""
    up = np.array([0.0, height, 0.0])
    a, b = np.array(start), np.array(end)
    cut = max(1, round(height / cell)), max(1, round(float(np.linalg.norm(b - a)) / cell))
    return patch([a + up, a, b, b + up], *cut)


def column(detail: float) -> Shape:
    """Plinth, torus base, shaft with entasis, bell capital, abacus; 3.4 m high."""
    n = count(26, detail, 8)
    bend = np.linspace(-np.pi / 2, np.pi / 2, count(8, detail, 3) + 1)
    torus = np.column_stack([0.35 + 0.07 * np.cos(bend), 0.32 + 0.07 * np.sin(bend)])
    t = np.linspace(0, 1, count(16, detail, 2) + 1)
    shaft = np.column_stack([0.32 - 0.06 * t**1.8, 0.39 + 2.41 * t])
    bell = np.linspace(0, 1, count(8, detail, 3) + 1)
    capital = np.column_stack([0.26 + 0.16 * bell**2.5, 2.86 + 0.34 * bell])
    ring = np.column_stack([0.26 + 0.05 * np.cos(bend), 2.83 + 0.03 * np.sin(bend)])
    blocks = box((-0.45, 0, -0.45), (0.45, 0.25, 0.45)), box((-0.44, 3.2, -0.44), (0.44, SPRING, 0.44))
    return merge(*blocks, *(lathe(profile, n) for profile in (torus, shaft, ring, capital)))


def arch(bay: float, top: float, detail: float) -> Shape:
    """One bay of arcade wall, 0.5 m thick, over a semicircular opening: front, back and soffit; bay centre at x = 0."""
    angle = np.linspace(np.pi, 0, count(26, detail, 6) + 1)
    x = np.concatenate([[-bay / 2], OPENING * np.cos(angle), [bay / 2]])
    y = np.concatenate([[SPRING], SPRING + OPENING * np.sin(angle), [SPRING]])
    rows = np.linspace(0, 1, count(5, detail, 1) + 1)[:, None]
    face = np.stack([np.broadcast_to(x, (len(rows), len(x))), top + (y - top) * rows, np.full((len(rows), len(x)), 0.25)], axis=-1)
    front = grid(face)
    back = flipped(grid(face * (1, 1, -1)))
    across = np.linspace(0.25, -0.25, count(4, detail, 1) + 1)[:, None]
    soffit = np.stack(np.broadcast_arrays(x, y, across), axis=-1)
    return merge(front, back, *(grid(soffit[:, part]) for part in (slice(0, 2), slice(1, -1), slice(-2, None))))


def balustrade(bay: float, detail: float) -> Shape:
    """Rail, foot and seven balusters of one bay."""
    t = np.linspace(0, 1, count(9, detail, 4) + 1)
    profile = np.column_stack([0.05 + 0.045 * np.sin(np.pi * t) * (1.3 - t), 0.1 + 0.7 * t])
    baluster = lathe(profile, count(12, detail, 5))
    posts = [(p + np.array([x, 0, 0], np.float32), n, f) for x in np.linspace(-1.35, 1.35, 7) for p, n, f in (baluster,)]
    h = bay / 2 - 0.35
    return merge(box((-h, 0.8, -0.12), (h, 0.92, 0.12)), box((-h, 0, -0.12), (h, 0.1, 0.12)), *posts)


def curtain(width: float, height: float, detail: float) -> Shape:
    """Gathered single-sheet cloth from x = 0 to `width`, tied at two fifths of its height."""
    u = np.linspace(0, 1, count(70, detail, 40) + 1)[None, :]
    v = np.linspace(1, 0, count(18, detail, 7) + 1)[:, None]
    waist = 1 - 0.55 * np.exp(-(((v - 0.4) / 0.16) ** 2))
    fold = 0.065 * np.sin(2 * np.pi * 4 * u + 1.5 * np.sin(3 * v)) * (0.55 + 0.45 * waist)
    return grid(np.stack([width * u * waist, np.broadcast_to(height * v, fold.shape), fold], axis=-1))


def banner(width: float, height: float, detail: float) -> Shape:
    """Hanging single-sheet banner with shallow waves; its top edge is at y = `height` / 2."""
    u = np.linspace(0, 1, count(20, detail, 4) + 1)[None, :]
    v = np.linspace(1, 0, count(28, detail, 5) + 1)[:, None]
    wave = 0.07 * np.sin(4 * np.pi * u + 3 * v) * (1.1 - v)
    return grid(np.stack([np.broadcast_to(width * u, wave.shape), np.broadcast_to(height * (v - 0.5), wave.shape), wave], axis=-1))


def pedestal(detail: float) -> Shape:
    """Stepped block with a round basin."""
    n = count(40, detail, 12)
    t = np.linspace(0, 1, count(12, detail, 3) + 1)
    basin = np.column_stack([0.45 + 0.45 * t**2, 0.5 + 0.45 * t])
    return merge(
        box((-1.1, 0, -1.1), (1.1, 0.18, 1.1)), box((-0.8, 0.18, -0.8), (0.8, 0.5, 0.8)),
        lathe(basin, n), lathe([(0.9, 0.95), (0.02, 0.95)], n),
    )  # fmt: skip


def knot(detail: float) -> Shape:
    """Trefoil knot of bronze tube, about 1.9 m high."""
    t = 2 * np.pi * np.arange(count(150, detail, 36) + 1) / count(150, detail, 36)
    t[-1] = 0.0
    path = np.column_stack([np.sin(3 * t), np.cos(t) - 2 * np.cos(2 * t), np.sin(t) + 2 * np.sin(2 * t)]) * (0.24, 0.33, 0.33)
    return tube(path, np.full(len(path), 0.13), count(22, detail, 7))
