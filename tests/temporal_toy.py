"""The specification's toy: a bumpy floor lit by two rectangles of exactly known irradiance, one of them moving.

Floor points z = 0, normals ∝ (-¼ sin 5x, -¼ cos 4y, 1). Rectangles face down: one at rest at (0, 0, 2), half sides 0.5, radiance
3; one at (0.75 sin 0.05vt, 0.5 cos 0.05vt, 0.9 + 0.1 sin 0.09vt), half sides 0.25 and 0.2, radiance 4. Distances are those to a
box of 5 × 5 × 2 and to the moving rectangle. Vector irradiance V is exact, hence E = n·V, ∇_r = n × V, and ∇_p by central
differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Records, Sites

F64 = NDArray[np.float64]
SIDE = 40
STEP = 1e-4
DIRECTIONS = 400


def normals(position: F64) -> F64:
    """Unit normals (N, 3) of floor points (N, 3)."""
    x, y = position[:, 0], position[:, 1]
    n = np.stack([-0.25 * np.sin(5 * x), -0.25 * np.cos(4 * y), np.ones_like(x)], axis=1)
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


@dataclass(frozen=True)
class Lamps:
    """The two rectangles at time t, in frames, at speed v."""

    t: float
    v: float

    @property
    def centre(self) -> F64:
        """Of the moving one."""
        s = self.v * self.t
        return np.array([0.75 * np.sin(0.05 * s), 0.5 * np.cos(0.05 * s), 0.9 + 0.1 * np.sin(0.09 * s)])

    def vector(self, position: F64) -> F64:
        """V (N, 3) at points (N, 3)."""
        out = np.zeros_like(position)
        for centre, (a, b), radiance in ((np.array([0.0, 0, 2]), (0.5, 0.5), 3.0), (self.centre, (0.25, 0.2), 4.0)):
            corners = centre + np.array([(-a, -b, 0), (-a, b, 0), (a, b, 0), (a, -b, 0)])
            ray = corners - position[:, None]
            ray /= np.linalg.norm(ray, axis=2, keepdims=True)
            after = np.roll(ray, -1, axis=1)
            cross = np.cross(ray, after)
            length = np.linalg.norm(cross, axis=2, keepdims=True)
            angle = np.arctan2(length, (ray * after).sum(axis=2, keepdims=True))
            part = radiance / 2 * (angle * cross / length).sum(axis=1)
            out += part * np.sign(part[:, 2:])
        return out

    def irradiance(self, position: F64, normal: F64) -> F64:
        """E (N,)."""
        return np.asarray(np.einsum("nc,nc->n", normal, self.vector(position)))

    def records(self, sites: Sites) -> Records:
        """Exact records, one value for all channels."""
        n, count = sites.normal, len(sites.position)
        vector = self.vector(sites.position)
        moved = [
            (self.irradiance(sites.position + h, n) - self.irradiance(sites.position - h, n)) / (2 * STEP)
            for h in np.eye(3)[:2] * STEP
        ]
        translation = np.stack([*moved, np.zeros(count)], axis=1)
        three = np.ones((1, 3))
        irradiance = np.einsum("nc,nc->n", n, vector)[:, None] * three
        gradients = (np.repeat(g[:, None], 3, axis=1) for g in (translation, np.cross(n, vector)))
        return Records(sites.position, n, self.distances(sites), irradiance, *gradients)

    def distances(self, sites: Sites) -> F64:
        """Harmonic mean distances (N,) over directions spread evenly over the upper hemisphere."""
        k = np.arange(DIRECTIONS)
        z = (k + 0.5) / DIRECTIONS
        phi = k * np.pi * (3 - np.sqrt(5))
        d = np.stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z], axis=1)
        p = sites.position[:, None]
        with np.errstate(divide="ignore"):
            walls = np.where(d > 0, (np.array([2.5, 2.5, 2.0]) - p) / d, (np.array([-2.5, -2.5, 0.0]) - p) / d)
        reach = np.where(d == 0, np.inf, walls).min(axis=2)
        along = (self.centre[2] - p[..., 2]) / d[:, 2]
        at = p + along[..., None] * d - self.centre
        hits = (np.abs(at[..., 0]) <= 0.25) & (np.abs(at[..., 1]) <= 0.2)
        return np.asarray(1 / np.mean(1 / np.where(hits, np.minimum(along, reach), reach), axis=1))
