"""Hemispheres seen through one square plane z = 1, |x|, |y| ≤ h, as a rasteriser would see them, and what makes up for the rest.

N × N pixels [i, j], x growing with i, y with j; q² = 1 + x² + y². A pixel's cosine-weighted solid angle is ∫ dA/q⁴, exactly, by
F(x, y) = ½ [x/√(1+x²) arctan(y/√(1+x²)) + y/√(1+y²) arctan(x/√(1+y²))] at its corners. Irradiance Σ c_p L_p is then

    plane      of what the plane sees alone: 17 % of a constant light is lost at h = 2
    coverage   that, divided by the share of the cosine that the plane covers                     Larsen & Christensen 2004
    axis       border pixels stretched to infinity along x and y
    radial     border pixels stretched away from the centre: a direction beyond the border takes the light of the pixel that it
               meets on its way in. Azimuths are kept                                                  Gautron 2006, section 4.2

Gradients follow from edges between pixels: a point at depth Z moves by -δ/Z on the plane when the observer moves by δ, and the
nearer of two neighbours decides:  ∂E/∂x = Σ (L_ij - L_{i-1,j}) / min(Z) ∫ dy/q⁴ along their edge; stretched pixels share radial
edges too.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.gradients import Moments
from renderers.transport.caching.hemisphere import Grid, Hemispheres, PolarSampler, records_of
from renderers.transport.caching.incoming import Incoming
from renderers.transport.caching.plane_kernels import rays_through, sums
from renderers.transport.caching.records import Records, Sites
from renderers.transport.hemispherical.quadrature import gauss_legendre
from renderers.transport.raycast import OFFSET

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Compensation = Literal["plane", "coverage", "axis", "radial"]
SIZE, HALF_WIDTH = 64, 2.0
FAR = 1e12
NODES = 8


class PlaneWeights(NamedTuple):
    """cosine, solid (N, N): (cosine-weighted) solid angle of each pixel; turn (N, N, 2): its share of the rotation gradient."""

    cosine: F64
    solid: F64
    turn: F64


def covered_cosine(half_width: float) -> float:
    """Share of π that the plane sees, F(h)."""
    g = half_width / np.sqrt(1 + half_width**2)
    return float(4 / np.pi * g * np.arctan(g))


def covered_solid_angle(half_width: float) -> float:
    """Share of 2π that the plane sees, F_Ω(h)."""
    return float(2 / np.pi * np.arcsin(half_width**2 / (1 + half_width**2)))


@lru_cache(maxsize=16)
def plane_weights(size: int = SIZE, half_width: float = HALF_WIDTH, compensation: Compensation = "radial") -> PlaneWeights:
    """Weights of a plane with size² pixels. `coverage` scales all of them by the cosine's share."""
    edges = np.linspace(-half_width, half_width, size + 1)
    if compensation == "axis":
        edges[[0, -1]] = -FAR, FAR
    x, y = np.meshgrid(edges, edges, indexing="ij")
    cosine, solid = _cells(_cosine_corner(x, y)), _cells(np.arctan(x / np.sqrt(1 + x * x + y * y) * y))
    turn = np.stack([-_cells(_moment_corner(y, x)), _cells(_moment_corner(x, y))], axis=-1)
    if compensation == "radial":
        _stretch(cosine, solid, turn, edges)
    scale = 1 / covered_cosine(half_width) if compensation == "coverage" else 1.0
    return PlaneWeights(cosine * scale, solid * scale, turn * scale)


def _cosine_corner(x: F64, y: F64) -> F64:
    a, b = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    return np.asarray((x / a * np.arctan(y / a) + y / b * np.arctan(x / b)) / 2)


def _moment_corner(x: F64, y: F64) -> F64:
    """Corner function of ∫ x dA/q⁴."""
    a = np.sqrt(1 + x * x)
    return np.asarray(-np.arctan(y / a) / (2 * a))


def _cells(corner: F64) -> F64:
    return np.asarray(np.diff(np.diff(corner, axis=0), axis=1))


def _sides(size: int) -> list[tuple[NDArray[np.intp], NDArray[np.intp], int, int]]:
    """Of each side: its pixels (i, j) in growing y or x, quarter turns from +x, whether they go with φ (1) or against (-1)."""
    run, last, none = np.arange(size), np.full(size, size - 1), np.zeros(size, np.intp)
    return [(last, run, 0, 1), (run, last, 1, -1), (none, run, 2, -1), (run, none, 3, 1)]


def _stretch(cosine: F64, solid: F64, turn: F64, edges: F64) -> None:
    """Add what border pixels gain by being pulled outwards. The weights of a side, seen from +x, are those of any other."""
    h, g = edges[-1], np.sqrt(1 + edges[-1] ** 2)
    phi = np.arctan2(edges, h)
    more_cosine = np.diff(phi - h / g * np.arctan(edges / g)) / 2
    more_solid = np.diff(np.arcsin(np.sin(phi) / g))
    nodes, share = gauss_legendre(NODES, 0, 1)
    angle = phi[:-1, None] + np.diff(phi)[:, None] * nodes
    beyond = np.arctan2(h, np.cos(angle))
    weight = (np.pi / 2 - beyond + np.sin(beyond) * np.cos(beyond)) / 2 * share * np.diff(phi)[:, None]
    for i, j, quarter, sense in _sides(len(cosine)):
        around = sense * angle + quarter * np.pi / 2
        cosine[i, j] += more_cosine
        solid[i, j] += more_solid
        turn[i, j, 0] -= (weight * np.sin(around)).sum(axis=1)
        turn[i, j, 1] += (weight * np.cos(around)).sum(axis=1)


class PlaneTables(NamedTuple):
    """Constants of a plane. cosine, turn: see `PlaneWeights`; slant (N, N): q, distance over depth; along (N - 1, N): ∫ dy/q⁴ of
    the edges between neighbours; first, second int (E, 2): pixels before and after the edges between stretched pixels; push (E, 2):
    what these add to the gradient."""

    cosine: F64
    turn: F64
    slant: F64
    along: F64
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    push: F64


@lru_cache(maxsize=16)
def plane_tables(size: int, half_width: float, compensation: Compensation) -> PlaneTables:
    """Of a plane with size² pixels."""
    weights = plane_weights(size, half_width, compensation)
    edges = np.linspace(-half_width, half_width, size + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    a = np.sqrt(1 + edges[1:-1] ** 2)[:, None]
    along = np.diff(edges / (2 * a**2 * (a**2 + edges**2)) + np.arctan(edges / a) / (2 * a**3), axis=1)
    slant, rim = np.sqrt(1 + middle[:, None] ** 2 + middle**2), _radial_edges(size, edges)
    if compensation != "radial":
        rim = rim[0][:0], rim[1][:0], rim[2][:0]
    return PlaneTables(weights.cosine, weights.turn, slant, along, *rim)


def _radial_edges(size: int, edges: F64) -> tuple[NDArray[np.intp], NDArray[np.intp], F64]:
    """Pixels before and after the edges between stretched pixels, (E, 2) each, and what a step of light over depth adds, (E, 2)."""
    reach = np.hypot(edges[-1], edges[1:-1])
    phi = np.arctan2(edges[1:-1], edges[-1])
    first, second, push = [], [], []
    for i, j, quarter, sense in _sides(size):
        around = sense * phi + quarter * np.pi / 2
        first.append(np.stack([i[:-1], j[:-1]], axis=1))
        second.append(np.stack([i[1:], j[1:]], axis=1))
        push.append(sense * np.stack([-np.sin(around), np.cos(around)], axis=1) / (2 * (1 + reach**2) * reach)[:, None])
    return np.concatenate(first), np.concatenate(second), np.concatenate(push)


def plane_moments(
    radiance: NDArray[np.floating], nearness: NDArray[np.floating], half_width: float = HALF_WIDTH,
    compensation: Compensation = "radial",
) -> Moments:  # fmt: skip
    """Moments of K planes with radiance (K, N, N, 3) and nearness 1/r (K, N, N), 0 where nothing is hit; without Hessian (0)."""
    count = len(nearness)
    out = np.zeros((count, 3)), np.zeros((count, 3, 2)), np.zeros((count, 3, 2)), np.zeros(count)
    sums(radiance, nearness, plane_tables(nearness.shape[1], half_width, compensation), *out)
    return Moments(*out, hessian=np.zeros((count, 3)))


class PlaneSampler(PolarSampler):
    """Computes records from rays through the pixel centres of one plane; in use like a `PolarSampler`. It knows no curvature."""

    def __init__(
        self, world: World, incoming: Incoming, seed: int = 0, size: int = SIZE, half_width: float = HALF_WIDTH,
        compensation: Compensation = "radial", counters: Counter[str] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(world, Grid(size, size), incoming, seed, False, counters)
        self._half_width, self._compensation = half_width, compensation
        self._local = plane_directions(size, half_width)

    def summed(self, sites: Sites, cast: Hemispheres) -> Records:
        """See `PolarSampler.summed`."""
        moments = plane_moments(cast.radiance, cast.nearness, self._half_width, self._compensation)
        return replace(records_of(sites, cast.tangents, moments), curvature=None)

    def _rays(self, sites: Sites, tangents: F64, random: F64) -> tuple[F32, F32]:
        return plane_rays(self._local, sites, tangents)


def side_of(rays: int) -> int:
    """Pixels a side of the plane with the number of rays nearest to one ≥ 4."""
    return max(2, round(float(np.sqrt(rays))))


def plane_directions(size: int = SIZE, half_width: float = HALF_WIDTH) -> F64:
    """Unit directions (size², 3) through the pixel centres, in the frame of the plane."""
    middle = (np.arange(size) + 0.5) * (2 * half_width / size) - half_width
    x, y = np.meshgrid(middle, middle, indexing="ij")
    local = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    return np.asarray(local / np.linalg.norm(local, axis=1, keepdims=True))


def plane_rays(local: F64, sites: Sites, tangents: F64) -> tuple[F32, F32]:
    """Origins and directions (K·P, 3) of rays along directions (P, 3) of frames with tangents (K, 2, 3), from K places."""
    shape = len(sites.position) * len(local), 3
    origins, directions = np.empty(shape, np.float32), np.empty(shape, np.float32)
    rays_through(local, *sites, tangents, OFFSET, origins, directions)
    return origins, directions
