"""BRDFs of glossy surfaces as coefficients: what radiance records are multiplied with, and which lobes are too sharp for that.

f_r cos θ_i of a material is a sum of terms, each a colour times a function of its shape alone (exponent or α):

    Phong   ρ_d · cos/π  +  ρ_s · lobe cos
    GGX     (1-f0) c_diff · (1-s) cos/π  +  f0 · (1-s) D Vis cos  +  s D Vis cos            s = (1 - |v·h|)⁵

The shapes are isotropic: their coefficients are tabulated by the angle θ_o of the viewer alone, in its plane, where only functions
with m ≥ 0 count, and turned about the normal to the viewer's azimuth, which is exact. `BrdfTable` does the same for any BRDF.

A shape's *tail* at a view is the relative L² error of its lobe at an order. A shape is held by the smallest order whose tail is at
most HELD at 60°; where a view is so grazing that the tail exceeds LOST, or where no order up to the largest holds the shape, pixels
are to be traced.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import GGX_KIND, LAMBERT, PHONG, World
from renderers.transport.brdf import Materials, ggx_colors, ggx_lobe, materials_at, mean_albedo, phong_lobe, schlick
from renderers.transport.hemispherical.basis import degrees, directions_of
from renderers.transport.hemispherical.brdf_table import brdf_coefficients
from renderers.transport.hemispherical.quadrature import Quadrature, hemisphere_quadrature
from renderers.transport.sampling import frame

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
HELD, LOST = 0.05, 0.15
STEEP = np.pi / 3
LARGEST_ORDER = 12
TERMS = 3
DIFFUSE, SHARP = -1, -2
VIEWS, MU_NODES, PHI_NODES = 64, 64, 128
SHARPEST_EXPONENT, SHARPEST_ALPHA = 200.0, 0.1  # sharper lobes would slip through the quadrature's nodes; no order holds them


class Shape(NamedTuple):
    """kind: PHONG or GGX_KIND; sharpness: exponent or α."""

    kind: int
    sharpness: float


class LobeTable(NamedTuple):
    """Of one shape. coefficients float32 (VIEWS, TERMS, C): those with m ≥ 0, θ_o from 0 to π/2; tail (VIEWS,): see above; fill:
    share of the hemisphere that its lobe fills at STEEP, (∫ f)² / (2π ∫ f²)."""

    coefficients: F32
    tail: F64
    fill: float


@lru_cache(maxsize=64)
def lobe_table(shape: Shape, order: int) -> LobeTable | None:
    """The table of a shape, None where it is too sharp for any."""
    fuzzy = shape.sharpness <= SHARPEST_EXPONENT if shape.kind == PHONG else shape.sharpness >= SHARPEST_ALPHA
    if not fuzzy:
        return None
    theta = np.linspace(0, np.pi / 2, VIEWS)
    views = directions_of(np.maximum(np.cos(theta), 1e-6), np.zeros(VIEWS))
    directions, weights = hemisphere_quadrature(MU_NODES, PHI_NODES)
    near = directions[:, 1] > 0  # even in y: half of the nodes do, for functions even in y (m ≥ 0)
    nodes = Quadrature(directions[near], 2 * weights[near])

    def evaluate(light: F64, view: F64) -> F64:
        return _terms(shape, light, view)

    even = degrees(order)[1] >= 0
    values = brdf_coefficients(evaluate, views, order, True, nodes).transpose(0, 2, 1)[:, :, even]
    lobes = [evaluate(nodes.directions, view)[:, 1:].sum(axis=1) * nodes.directions[:, 2] for view in views]
    energy = np.array([np.sum(lobe**2 * nodes.weights) for lobe in lobes])
    kept = (values[:, 1:].sum(axis=1) ** 2).sum(axis=1)
    tail = np.sqrt(np.maximum(0, 1 - kept / energy))
    steep = _steep()
    fill = float(np.sum(lobes[steep] * nodes.weights)) ** 2 / (2 * np.pi * energy[steep])
    return LobeTable(np.ascontiguousarray(values, np.float32), tail, fill)


def _terms(shape: Shape, light: F64, view: F64) -> F64:
    """Values (Q, TERMS) for light (Q, 3) and view (3,), without cosine."""
    out = np.zeros((len(light), TERMS))
    if shape.kind == PHONG:
        out[:, 0] = 1 / np.pi
        out[:, 1] = phong_lobe(shape.sharpness, light @ np.array([-view[0], -view[1], view[2]]))
        return out
    half = light + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    fresnel = schlick(half @ view)
    lobe = ggx_lobe(shape.sharpness, light[:, 2], view[2], half[:, 2], half[:, 0] ** 2 + half[:, 1] ** 2)
    out[:, 0], out[:, 1], out[:, 2] = (1 - fresnel) / np.pi, (1 - fresnel) * lobe, fresnel * lobe
    return out


def order_of_shape(shape: Shape, largest: int = LARGEST_ORDER) -> int | None:
    """Smallest order ≥ 2 that holds a shape, None where none up to the largest does."""
    table = lobe_table(shape, largest)
    if table is None:
        return None
    energy = _degree_shares(table, largest)
    held = np.flatnonzero(np.sqrt(np.maximum(0, energy)) <= HELD)
    return int(max(2, held[0])) if len(held) else None


def _degree_shares(table: LobeTable, order: int) -> F64:
    """Share of a lobe's energy at STEEP that orders 0 … `order` miss, (order + 1,)."""
    view = _steep()
    degree, m = degrees(order)
    power = table.coefficients[view, 1:].sum(axis=0).astype(np.float64) ** 2
    of_degree = np.bincount(degree[m >= 0], power, order)
    kept = np.concatenate([[0.0], np.cumsum(of_degree)])
    return np.asarray(1 - kept / kept[-1] * (1 - table.tail[view] ** 2))


def _steep() -> int:
    """The view of tables nearest to STEEP."""
    return int(np.searchsorted(np.linspace(0, np.pi / 2, VIEWS), STEEP))


class Gloss(NamedTuple):
    """Glossy materials of a World in radiance records of one order.

    order: 0 where no record is needed. shape int64 (materials,): which table, or DIFFUSE, or SHARP: to be traced.
    tables float32 (shapes, VIEWS, TERMS, C). reach (shapes,): the largest θ_o whose tail is at most LOST. fill (shapes,): see
    `LobeTable`. truncated: numbers of materials that are cached though no order holds them.
    """

    order: int
    shape: NDArray[np.int64]
    tables: F32
    reach: F64
    fill: F64
    truncated: tuple[int, ...] = ()

    @property
    def shiny(self) -> bool:
        """Whether any material is glossy at all."""
        return bool((self.shape != DIFFUSE).any())

    def cached(self, gbuffer: GBuffer) -> NDArray[np.bool_]:
        """Pixels (H, W) whose light radiance records are to give."""
        shape, cosine = self._pixels(gbuffer)
        least = np.cos(np.append(self.reach, 0.0))[np.maximum(shape, DIFFUSE)]
        return np.asarray((shape >= 0) & (cosine >= least))

    def traced(self, gbuffer: GBuffer) -> NDArray[np.bool_]:
        """Pixels (H, W) whose lobes are to be traced: glossy, and not `cached`."""
        shape, _ = self._pixels(gbuffer)
        return np.asarray((shape == SHARP) | (shape >= 0)) & ~self.cached(gbuffer)

    def diffuse(self, world: World, gbuffer: GBuffer) -> F64:
        """Albedo float64 (H, W, 3) of what irradiance records are to give: diffuse surfaces, diffuse terms of traced ones."""
        shape, cosine = self._pixels(gbuffer)
        albedo = np.where((gbuffer.covered & ~self.cached(gbuffer))[..., None], gbuffer.base, 0).astype(np.float64)
        material = gbuffer.material
        rows = np.flatnonzero((shape != DIFFUSE) & gbuffer.covered & (world.materials.kind[material] == GGX_KIND))
        flat = albedo.reshape(-1, 3)
        f0, base = ggx_colors(materials_at(world.materials, material.ravel()[rows], flat[rows]))
        flat[rows] = (1 - f0) * base * _transmitted(cosine.ravel()[rows])[:, None]
        return albedo

    def _pixels(self, gbuffer: GBuffer) -> tuple[NDArray[np.int64], F64]:
        """Table number (-1 on the background) and cosine of the viewer's angle, (H, W) each."""
        view = gbuffer.eye - gbuffer.position
        length = np.maximum(np.linalg.norm(view, axis=2), 1e-12)
        cosine = np.einsum("yxc,yxc->yx", view, gbuffer.normal) / length
        return np.where(gbuffer.covered, self.shape[gbuffer.material], DIFFUSE), cosine


def stand_in_albedo(world: World, gbuffer: GBuffer) -> F64:
    """Diffuse reflectance of each pixel, of glossy surfaces their mean albedo: float64 (H, W, 3), 0 on the background."""
    albedo = np.where(gbuffer.covered[..., None], gbuffer.base, 0).astype(np.float64)
    rows = np.flatnonzero(gbuffer.covered & (world.materials.kind[gbuffer.material] != LAMBERT))
    if len(rows):
        flat = albedo.reshape(-1, 3)
        flat[rows] = mean_albedo(materials_at(world.materials, gbuffer.material.ravel()[rows], flat[rows]))
    return albedo


def _transmitted(cosine: F64) -> F64:
    """∫ (1 - s) cos/π dω of GGX's diffuse term at the viewer's cosine (N,); it doesn't depend on α."""
    table = lobe_table(Shape(GGX_KIND, 1.0), 2)
    assert table is not None  # the widest lobe there is
    whole = table.coefficients[:, 0, 0] * np.sqrt(2 * np.pi)
    return np.asarray(np.interp(np.arccos(np.clip(cosine, 0, 1)), np.linspace(0, np.pi / 2, VIEWS), whole))


def gloss_of(world: World, order: int | None = None, truncate: bool = False) -> Gloss:
    """Tables of the materials that a World's surfaces have. order: None for the smallest that holds all that can be held.

    truncate: cache lobes that no order holds as well, truncated.
    """
    table = world.materials
    used = np.unique(world.material)
    shiny = (table.kind[used] == GGX_KIND) | ((table.kind[used] == PHONG) & table.specular[used].any(axis=1))
    of_material = {int(m): _shape(world, int(m)) for m in used[shiny]}
    largest = LARGEST_ORDER if order is None else order
    orders = {shape: order_of_shape(shape, largest) for shape in sorted(set(of_material.values()))}
    wanted = [s for s, held in orders.items() if held is not None or (truncate and lobe_table(s, largest) is not None)]
    found = (max((orders[s] or largest for s in wanted), default=0) if order is None else order) if wanted else 0
    rows = np.full(len(table.kind), DIFFUSE, np.int64)
    for material, shape in of_material.items():
        rows[material] = wanted.index(shape) if shape in wanted else SHARP
    truncated = tuple(m for m, s in of_material.items() if s in wanted and orders[s] is None)
    return _stacked(found, rows, wanted, truncated, truncate)


def _shape(world: World, material: int) -> Shape:
    table = world.materials
    kind = int(table.kind[material])
    return Shape(kind, float(table.exponent[material] if kind == PHONG else table.alpha[material]))


def _stacked(order: int, rows: NDArray[np.int64], shapes: Sequence[Shape], truncated: tuple[int, ...], truncate: bool) -> Gloss:
    tables = [found for shape in shapes if (found := lobe_table(shape, order)) is not None]
    theta = np.linspace(0, np.pi / 2, VIEWS)
    reach = [np.pi / 2 if truncate or not (t.tail > LOST).any() else theta[np.argmax(t.tail > LOST)] for t in tables]
    held = np.stack([t.coefficients for t in tables]) if tables else np.zeros((0, VIEWS, TERMS, 0), np.float32)
    return Gloss(order, rows, held, np.array(reach), np.array([t.fill for t in tables]), truncated)


class Lobes:
    """Coefficients of f_r cos θ_i at pixels, for the colour channels: what `glossy.reflected` multiplies records with."""

    def __init__(self, world: World, gbuffer: GBuffer, rows: NDArray[np.intp], gloss: Gloss) -> None:
        self._gloss = gloss
        material = gbuffer.material.ravel()[rows]
        self._table = gloss.shape[material]
        self._colours = term_colours(materials_at(world.materials, material, gbuffer.base.reshape(-1, 3)[rows]))
        position, normal = (a.reshape(-1, 3)[rows].astype(np.float64) for a in (gbuffer.position, gbuffer.normal))
        view = gbuffer.eye - position
        view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
        axes = np.stack([*frame(normal), normal], axis=1)
        self._view = np.einsum("nij,nj->ni", axes, view)

    def __call__(self, part: slice) -> F32:
        """Of some of the pixels, float32 (N, 3, order²), in the frames `sampling.frame(normal)`."""
        order = self._gloss.order
        out = np.zeros((len(self._table[part]), 3, order**2), np.float32)
        degree, m = degrees(order)
        place = (degree * (degree + 1))[m >= 0], m[m >= 0]
        _coefficients(self._gloss.tables, self._table[part], self._view[part], self._colours[part], *place, out)
        return out


def term_colours(m: Materials) -> F64:
    """Colours of the terms, float64 (N, TERMS, 3)."""
    colours = np.stack([m.base, m.specular, np.zeros_like(m.base)], axis=1)
    rows = np.flatnonzero(m.kind == GGX_KIND)
    f0, diffuse = ggx_colors(m.rows(rows))
    colours[rows] = np.stack([(1 - f0) * diffuse, f0, np.ones_like(f0)], axis=1)
    return colours


@numba.njit(parallel=True, cache=True)
def _coefficients(tables, number, view, colours, middle, azimuthal, out):  # type: ignore[no-untyped-def]
    """out (N, 3, n²) from tables at the viewer's angle, turned to its azimuth; middle, azimuthal (C,): l(l+1) and m of each."""
    last = tables.shape[1] - 1
    for p in numba.prange(len(number)):
        theta = np.arctan2(np.hypot(view[p, 0], view[p, 1]), max(view[p, 2], 0.0))
        place = theta / (np.pi / 2) * last
        lower = min(int(place), last - 1)
        t = place - lower
        near, far = tables[number[p], lower], tables[number[p], lower + 1]
        phi = np.arctan2(view[p, 1], view[p, 0])
        for i in range(len(middle)):
            m = azimuthal[i]
            cosine, sine = np.cos(m * phi), np.sin(m * phi)
            for c in range(3):
                value = 0.0
                for term in range(near.shape[0]):
                    value += colours[p, term, c] * (near[term, i] + t * (far[term, i] - near[term, i]))
                out[p, c, middle[i] + m] = cosine * value
                if m:
                    out[p, c, middle[i] - m] = sine * value
