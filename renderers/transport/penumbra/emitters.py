"""Area lights of a World: emissive triangles grouped into emitters, and stratified points on each.

One emitter is one connected plane of one instance (rectangle, disc or any planar polygon), a sphere, or one of six groups of a
curved mesh's triangles, by the axis that their normals are nearest to. Emitters do not cast shadows of their own light.

Points (St-Amour 2004 §3.1): N regions of equal area, one uniform random point in each. A rectangle has rows of cells; a disc takes
those of a square, mapped area-true (Shirley & Chiu 1997); polygons and meshes stratify the cumulative area and shift a van der
Corput set across it. Or, on rectangles and discs, a shifted Hammersley set, (i/N, radical inverse of i): N rows and N columns have
one point each, and so have all the boxes of a power of two between them. Half the error of the strata on smooth penumbrae.

A sphere of radius R looks the same from everywhere, so its points must look like a uniform disc from everywhere. The density in
the ball that does is g(ρ) ∝ 1 / √(R² - ρ²), the Abel inverse of a constant disc: with ρ = R sin θ, θ has density ∝ sin² θ on
[0, π/2]. One set serves all pyramids.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from renderers.images import LUMA
from renderers.scene.world import World
from renderers.transport.sampling import fold, generator, pick, uniform_sphere

F64 = NDArray[np.float64]
Kind = Literal["rectangle", "disc", "polygon", "sphere", "mesh"]
Pattern = Literal["stratified", "hammersley"]
FLAT = 1e-4


@dataclass(frozen=True, eq=False)
class Emitter:
    """One area light. triangles: rows of World.triangles. centre (3,); frame (3, 3): rows are tangents and normal, orthonormal.

    half (2,): half extents along the tangents (rectangle), or the radius twice (disc, sphere), World units. corners (T, 3, 3).
    one_sided: shines to the side of its normal only. power: area × luminance of the radiance, to rank lights.
    """

    kind: Kind
    triangles: NDArray[np.int64]
    centre: F64
    frame: F64
    half: F64
    corners: F64
    one_sided: bool
    power: float

    @property
    def size(self) -> float:
        """Largest half extent, World units."""
        return float(self.half.max())

    def points(
        self,
        count: int,
        seed: int,
        index: int = 0,
        emission: NDArray[np.floating] | None = None,
        pattern: Pattern = "stratified",
    ) -> F64:
        """`count` even points on (sphere: in) the emitter, World, float64 (count, 3), a pure function of its arguments.

        pattern: how they lie on a rectangle or a disc.

        emission (h, w): how bright the light is over its rectangle (rows along the second tangent), or over the square that is
        mapped to its disc. Points lie where it shines, as many as it shines, so that each stands for the same light; hidden shares
        then are shares of its power. Raises ValueError for other kinds, and for an emission that is negative or nowhere positive.
        """
        rng = generator(seed, f"light points {index}")
        if emission is not None and self.kind not in ("rectangle", "disc"):
            raise ValueError(f"a {self.kind} emitter shines evenly: emission is for rectangles and discs")
        if self.kind in ("rectangle", "disc"):
            even = stratified(count, rng) if pattern == "stratified" else hammersley(count, rng)
            square = (even if emission is None else distributed(even, emission)) * 2 - 1
            flat = square * self.half if self.kind == "rectangle" else concentric(square) * self.half[0]
            return np.asarray(self.centre + flat @ self.frame[:2])
        u = ((np.arange(count) + rng.random(count)) / count)[rng.permutation(count)]
        set2 = (np.asarray(qmc.Halton(2, scramble=False).random(count)) + rng.random(2)) % 1.0
        if self.kind == "sphere":
            return np.asarray(self.centre + uniform_sphere(set2) * (self.half[0] * ball_radius(u))[:, None])
        areas = np.linalg.norm(np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]), axis=1)
        chosen, b, c = fold(pick(areas, u), set2[:, 0], set2[:, 1])
        p = self.corners[chosen]
        return np.asarray(p[:, 0] + b[:, None] * (p[:, 1] - p[:, 0]) + c[:, None] * (p[:, 2] - p[:, 0]))


def emitters_of(world: World) -> list[Emitter]:
    """All area lights, brightest first."""
    found = []
    for instance in np.unique(world.instance[world.emissive]):
        rows = world.emissive[world.instance[world.emissive] == instance].astype(np.int64)
        ball = _sphere(world, rows)
        if ball is not None:
            found.append(ball)
            continue
        groups = _planes(world, rows)
        if len(groups) > 6:
            axis = np.argmax(np.abs(world.face_normals[rows]), axis=1)
            side = np.take_along_axis(world.face_normals[rows], axis[:, None], axis=1)[:, 0] > 0
            groups = [rows[2 * axis + side == k] for k in range(6)]
            found += [_flat(world, group, "mesh") for group in groups if len(group)]
        else:
            found += [_flat(world, group, "polygon") for group in groups]
    return sorted(found, key=lambda e: (-e.power, int(e.triangles[0])))


def stratified(count: int, rng: np.random.Generator) -> F64:
    """One uniform random point in each of `count` cells of equal area of [0, 1)², (count, 2); √count rows, square where that is
    whole.
    """
    rows = max(round(count**0.5), 1)
    columns = np.diff(np.floor(np.linspace(0, count, rows + 1)).astype(int))
    jitter = rng.random((count, 2))
    y0 = np.concatenate([[0], np.cumsum(columns)]) / count
    row = np.repeat(np.arange(rows), columns)
    column = np.concatenate([np.arange(n) for n in columns])
    x = (column + jitter[:, 0]) / columns[row]
    y = y0[row] + jitter[:, 1] * columns[row] / count
    return np.stack([x, y], axis=1)


def hammersley(count: int, rng: np.random.Generator) -> F64:
    """The Hammersley set of `count` points on the torus [0, 1)², moved at random; (count, 2) (Hammersley 1960; Cranley & Patterson
    1976).
    """
    even = np.stack([np.arange(count) / count, np.asarray(qmc.Halton(1, scramble=False).random(count))[:, 0]], axis=1)
    return np.asarray((even + rng.random(2)) % 1.0)


def distributed(even: F64, density: NDArray[np.floating]) -> F64:
    """Even points (N, 2) of the unit square moved so that they follow a density (h, w): rows first, then columns, both inverted."""
    d = np.asarray(density, np.float64)
    if d.ndim != 2 or not (d >= 0).all() or not d.sum() > 0:
        raise ValueError("emission must be two-dimensional, nowhere negative and somewhere positive")
    rows = np.concatenate([[0], np.cumsum(d.sum(axis=1))]) / d.sum()
    y = np.clip(np.searchsorted(rows, even[:, 1], side="right") - 1, 0, len(d) - 1)
    inside = (even[:, 1] - rows[y]) / (rows[y + 1] - rows[y])
    line = d[y]
    columns = np.concatenate([np.zeros((len(y), 1)), np.cumsum(line, axis=1)], axis=1) / line.sum(axis=1, keepdims=True)
    x = np.clip((columns <= even[:, :1]).sum(axis=1) - 1, 0, d.shape[1] - 1)
    pick = np.arange(len(x))
    across = (even[:, 0] - columns[pick, x]) / (columns[pick, x + 1] - columns[pick, x])
    return np.stack([(x + across) / d.shape[1], (y + inside) / len(d)], axis=1)


def concentric(square: F64) -> F64:
    """[-1, 1]² to the unit disc, area-true up to a constant, neighbours stay neighbours (Shirley & Chiu 1997); (N, 2)."""
    x, y = square[:, 0], square[:, 1]
    wide = np.abs(x) > np.abs(y)
    radius = np.where(wide, x, y)
    safe = np.where(radius == 0, 1.0, radius)
    angle = np.where(wide, np.pi / 4 * y / safe, np.pi / 2 - np.pi / 4 * x / safe)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def ball_radius(u: F64) -> F64:
    """Radii in [0, 1] whose isotropic points project to a uniform disc: sin θ with (θ - sin θ cos θ) · 2/π = u, by bisection."""
    low, high = np.zeros_like(u), np.full_like(u, np.pi / 2)
    for _ in range(52):
        middle = (low + high) / 2
        below = (middle - np.sin(middle) * np.cos(middle)) * 2 / np.pi < u
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(np.sin((low + high) / 2))


def _sphere(world: World, rows: NDArray[np.int64]) -> Emitter | None:
    """The sphere that these triangles make up, if they do: all vertices at one distance, the area that of a closed sphere."""
    if len(rows) < 48:
        return None
    corners = world.positions[world.triangles[rows]].astype(np.float64)
    area = float(world.areas[rows].sum())
    vertices = np.unique(corners.reshape(-1, 3), axis=0)
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    distance = np.linalg.norm(vertices - centre, axis=1)
    radius = np.sqrt(area / (4 * np.pi))
    if np.ptp(distance) > 0.02 * radius or abs(distance.mean() / radius - 1) > 0.02:
        return None
    half = np.full(2, radius)
    return Emitter("sphere", rows, centre, np.eye(3), half, corners, False, _power(world, rows) / 4)


def _planes(world: World, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Groups of triangles that share a plane."""
    normal = world.face_normals[rows]
    height = np.einsum("ij,ij->i", normal, world.positions[world.triangles[rows, 0]].astype(np.float64))
    key = np.round(np.concatenate([normal, height[:, None]], axis=1) / (10 * FLAT)).astype(np.int64)
    _, label = np.unique(key, axis=0, return_inverse=True)
    return [rows[label.ravel() == k] for k in range(int(label.max()) + 1)]


def _flat(world: World, rows: NDArray[np.int64], kind: Kind) -> Emitter:
    """An emitter with one normal: rectangle or disc where the triangles make one up, else `kind`."""
    corners = world.positions[world.triangles[rows]].astype(np.float64)
    areas = world.areas[rows]
    normal = (world.face_normals[rows] * areas[:, None]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    centre = (corners.mean(axis=1) * areas[:, None]).sum(axis=0) / areas.sum()
    edge = corners[0, 1] - corners[0, 0]
    edge = edge - (edge @ normal) * normal
    edge /= np.linalg.norm(edge)
    frame = np.stack([edge, np.cross(normal, edge), normal])
    one_sided = not world.materials.emits_both[world.material[rows[0]]]
    vertices = np.unique(corners.reshape(-1, 3), axis=0)
    if kind == "polygon":
        distance = np.linalg.norm(vertices - centre, axis=1)
        rim = distance > distance.max() / 2
        radius = np.sqrt(areas.sum() / np.pi)
        if len(rows) == 2 and len(vertices) == 4 and np.ptp(distance) < FLAT * distance.max():
            return _rectangle(world, rows, corners, vertices, centre, normal, one_sided)
        if rim.sum() >= 16 and np.ptp(distance[rim]) < 1e-3 * radius and abs(distance.max() / radius - 1) < 0.02:
            return Emitter("disc", rows, centre, frame, np.full(2, radius), corners, one_sided, _power(world, rows))
    half = np.abs((vertices - centre) @ frame[:2].T).max(axis=0)
    return Emitter(kind, rows, centre, frame, half, corners, one_sided, _power(world, rows))


def _rectangle(
    world: World, rows: NDArray[np.int64], corners: F64, vertices: F64, centre: F64, normal: F64, one_sided: bool
) -> Emitter:
    """Four corners at one distance from their centre: the frame along the sides, half extents from it."""
    # the two shorter ways from a corner to the others are the sides, the longest is the diagonal
    others = vertices[1:] - vertices[0]
    sides = others[np.argsort(np.linalg.norm(others, axis=1))][:2]
    lengths = np.linalg.norm(sides, axis=1)
    x = sides[0] / lengths[0]
    frame = np.stack([x, np.cross(normal, x), normal])
    middle = vertices.mean(axis=0)
    return Emitter("rectangle", rows, middle, frame, lengths / 2, corners, one_sided, _power(world, rows))


def _power(world: World, rows: NDArray[np.int64]) -> float:
    radiance = world.materials.emission[world.material[rows]].astype(np.float64) @ LUMA
    return float((radiance * world.areas[rows]).sum())
