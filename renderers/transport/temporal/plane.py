"""The square sampling plane of the publication: its weights, its moments, and reprojection on it.

A record camera looks along the normal at a plane at distance 1 that covers [-S, S]² in the tangent axes, M × M pixels of side Δ.
The missing directions are those of stretched border pixels. `trc` samples polar hemispheres instead, which miss none; this is what
the published figures of reprojection are compared with, and the oracle of `renderers.gl.reprojection`.

    E      = Σ W_ij L_ij,   W_ij = Δ²/(1 + ρ²)² + border                                       ρ² = x² + y²
    ∇_r E  = Σ c_ij L_ij,   c_ij = Δ²/(1 + ρ²)² (-y, x) + border
    ∇_p E·u = Σ Δ (L_i - L_{i-1}) / (min(z_i, z_{i-1}) (1 + x_b² + y²)²), x_b between the two; likewise along v
    border: the azimuths of a pixel's outer edge, from the polar angle of that edge to π/2

Images are (M, M), rows along v, columns along u. Plane depth z is measured along the normal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.temporal.reprojection import SNAP, fill

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
PARTS = 8
BEHIND = 1e-6


class Drawn(NamedTuple):
    """A reprojected image: source int64 (M, M), number of the point in each pixel; depth float32 (M, M); holes bool (M, M):
    pixels that received nothing before they were filled."""

    source: I64
    depth: F32
    holes: NDArray[np.bool_]


@dataclass(frozen=True)
class Plane:
    """M × M pixels over [-S, S]²: side = M, half = S."""

    side: int = 64
    half: float = 2.0

    @property
    def step(self) -> float:
        """Δ."""
        return 2 * self.half / self.side

    @cached_property
    def centres(self) -> F64:
        """Coordinates of pixel centres, (M,)."""
        return self._points(1)

    @cached_property
    def directions(self) -> F64:
        """Unit directions (M, M, 3) through pixel centres, in the axes u, v, n."""
        x, y = np.meshgrid(self.centres, self.centres)
        away = np.stack([x, y, np.ones_like(x)], axis=-1)
        return np.asarray(away / np.linalg.norm(away, axis=-1, keepdims=True))

    @cached_property
    def inner(self) -> F64:
        """Weights of irradiance without the border, (M, M); their sum over π is the share of the irradiance that the plane sees."""
        return self._means(lambda x, y: self.step**2 / (1 + x**2 + y**2) ** 2)

    @cached_property
    def weights(self) -> F64:
        """W, (M, M)."""
        q = self.half / np.sqrt(1 + self.half**2)
        edges = np.linspace(-self.half, self.half, self.side + 1)
        border = np.diff((np.arctan(edges / self.half) - q * np.arctan(q * edges / self.half)) / 2)
        out = self.inner.copy()
        for line in (out[0], out[-1], out[:, 0], out[:, -1]):
            line += border
        return out

    @cached_property
    def turns(self) -> F64:
        """c, (M, M, 2)."""
        out = np.stack([self._means(lambda x, y, s=sign, k=k: s * (y, x)[k] * self.step**2 / (1 + x**2 + y**2) ** 2)
                        for k, sign in enumerate((-1, 1))], axis=-1)  # fmt: skip
        along = self._points(PARTS)
        theta = np.arctan(np.hypot(along, self.half))
        swept = (np.pi / 2 - theta) / 2 + np.sin(2 * theta) / 4
        turn = self.half / (self.half**2 + along**2) * self.step / PARTS  # dφ
        radius = np.hypot(along, self.half)
        outward, sideways = ((swept * turn * a / radius).reshape(self.side, PARTS).sum(axis=1) for a in (self.half, along))
        for sign, column in ((1, out[:, -1]), (-1, out[:, 0])):  # x = ±S: (cos φ, sin φ) = (±S, y)/ρ
            column += np.stack([-sideways, sign * outward], axis=-1)
        for sign, row in ((1, out[-1]), (-1, out[0])):
            row += np.stack([-sign * outward, sideways], axis=-1)
        return out

    def moments(self, radiance: F64, depth: F64) -> tuple[F64, F64, F64]:
        """Irradiance (C,), translation and rotation gradient (C, 2) along u, v, of images (M, M, C) with plane depths (M, M)."""
        x, between = self.centres, self.centres[1:] - self.step / 2
        rotation = np.einsum("jic,jik->ck", radiance, self.turns)
        along = self.step / (np.minimum(depth[:, 1:], depth[:, :-1]) * (1 + between[None] ** 2 + x[:, None] ** 2) ** 2)
        across = self.step / (np.minimum(depth[1:], depth[:-1]) * (1 + between[:, None] ** 2 + x[None] ** 2) ** 2)
        translation = np.stack(
            [np.einsum("ji,jic->c", along, np.diff(radiance, axis=1)), np.einsum("ji,jic->c", across, np.diff(radiance, axis=0))], 1
        )
        return np.einsum("ji,jic->c", self.weights, radiance), translation, rotation

    def distance(self, depth: F64) -> float:
        """Harmonic mean distance R of an image of plane depths."""
        x, y = np.meshgrid(self.centres, self.centres)
        angle = (1 + x**2 + y**2) ** -1.5
        return float(angle.sum() / (angle / (depth * np.sqrt(1 + x**2 + y**2))).sum())

    def reprojected(self, points: F64) -> Drawn:
        """Points (N, 3) relative to the record, in the axes u, v, n, drawn one pixel large, nearest on top, holes filled."""
        index = np.flatnonzero(points[:, 2] > BEHIND)
        scaled = points[index, :2] / points[index, 2:] / self.half
        column, row = np.floor((scaled + 1) / 2 * self.side + SNAP).astype(np.int64).T
        inside = (column >= 0) & (column < self.side) & (row >= 0) & (row < self.side)
        index, row, column = index[inside], row[inside], column[inside]
        order = np.argsort(-points[index, 2], kind="stable")
        source = np.full((self.side, self.side), -1)
        depth = np.zeros((self.side, self.side), np.float32)
        source[row[order], column[order]] = index[order]
        depth[row[order], column[order]] = points[index[order], 2]
        holes = source < 0
        fill(depth, source, np.flatnonzero(holes), cyclic=False)
        return Drawn(source, depth, holes)

    def _points(self, parts: int) -> F64:
        count = self.side * parts
        return np.asarray(-self.half + (np.arange(count) + 0.5) * 2 * self.half / count)

    def _means(self, function: Callable[[F64, F64], F64]) -> F64:
        fine = self._points(PARTS)
        values = function(*np.meshgrid(fine, fine))
        return np.asarray(values.reshape(self.side, PARTS, self.side, PARTS).mean(axis=(1, 3)))
