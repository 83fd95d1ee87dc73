"""Reflective shadow maps (Dachsbacher & Stamminger 2005): light of a map's texels at every pixel. Twin of `gl.reflective`.

    L(x) = Σ_i w_i · f_r G_b(x, y_i) · Φ(y_i)/π          y_i: what the map holds in n directions of a disc around x's own

The disc is one of directions around the one from the light to x, or of the tile's plane when rays are parallel. Polar samples
(r ξ₁, 2π ξ₂) crowd at its centre; the weight that undoes this is their Jacobian, w = 2π r sin(r ξ₁) / n for directions and
2π r² ξ₁ / n in a plane, so that the sum converges to the integral over the disc. The publication prints ξ₁² for it, normalised.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.reflective import LightView, ReflectiveMap
from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import materials_at, mean_albedo
from renderers.transport.gather import pixels_of
from renderers.transport.kernels import SAFE_R2, reflect
from renderers.transport.raycast import caster_of
from renderers.transport.sampling import generator, uniform_numbers
from renderers.transport.surface import surface_at

F32 = NDArray[np.float32]
Weights = Literal["area", "published"]


def cast_map(world: World, view: LightView) -> tuple[F32, F32, NDArray[np.int32]]:
    """First hits of the light's rays: position and base colour float32 (n · R, R, 3), triangle int32 (n · R, R), -1 for a miss."""
    origins, directions = view.rays()
    shape = origins.shape[:2]
    hits = caster_of(world).first_hit(origins.reshape(-1, 3), directions.reshape(-1, 3))
    seen = np.flatnonzero(hits.triangle >= 0)
    surface = surface_at(world, hits.triangle[seen], hits.u[seen], hits.v[seen])
    position, base = np.zeros((2, len(hits.triangle), 3), np.float32)
    position[seen], base[seen] = surface.position, surface.base
    return position.reshape(*shape, 3), base.reshape(*shape, 3), hits.triangle.reshape(shape)


def reflective_map(world: World, view: LightView, position: F32, base: F32, triangle: NDArray[np.int32]) -> ReflectiveMap:
    """Normals and reflected flux of what a light sees. Glossy surfaces reflect as diffuse ones of their mean albedo."""
    seen = triangle >= 0
    _, directions = view.rays()
    normal, flux = np.zeros((2, *triangle.shape, 3), np.float32)
    geometric = world.face_normals[triangle[seen]]
    towards = np.sum(geometric * directions[seen], axis=-1, keepdims=True) < 0
    normal[seen] = np.where(towards, geometric, -geometric)
    material = world.material[triangle[seen]]
    albedo = base[seen].astype(np.float64)
    if (world.materials.kind[material] != LAMBERT).any():
        albedo = mean_albedo(materials_at(world.materials, material, base[seen]))
    flux[seen] = albedo * view.emitted(directions[seen])
    return ReflectiveMap(view, position, normal, flux)


def disc_samples(view: LightView, radius: float, count: int, seed: int, weights: Weights = "area") -> F32:
    """The n samples of a disc, the same for every pixel, float32 (n, 4): offsets and weight.

    radius: in widths of the map (of its opening angle, 2π for a point light); discs of directions end at the opposite pole.
    Directions: (cos r, sin r cos φ, sin r sin φ, w); a plane: (0, r cos φ, r sin φ, w) in World units.
    """
    xi = uniform_numbers(count, 2, generator(seed, "reflective disc"), "low-discrepancy")
    angle = 2 * np.pi * xi[:, 1]
    if view.parallel:
        reach = radius * 2 * float(view.half.max())
        first, across, measure = np.zeros(count), reach * xi[:, 0], np.pi * reach**2
        jacobian = 2 * measure * xi[:, 0]
    else:
        reach = min(radius * opening(view), np.pi)
        first, across, measure = np.cos(reach * xi[:, 0]), np.sin(reach * xi[:, 0]), 2 * np.pi * (1 - np.cos(reach))
        jacobian = 2 * np.pi * reach * across
    # ∫ ξ² dξ = 1/3: constant light keeps its sum
    weight = (jacobian if weights == "area" else 3 * measure * xi[:, 0] ** 2) / count
    return np.stack([first, across * np.cos(angle), across * np.sin(angle), weight], axis=1).astype(np.float32)


def opening(view: LightView) -> float:
    """Full opening angle of a light that isn't parallel, in radians."""
    if view.kind == "spot":
        return 2 * float(np.arccos(np.clip(view.cosines[1], -1, 1)))
    return np.pi if view.kind == "area" else 2 * np.pi


def gather_map(
    gbuffer: GBuffer, world: World, seen: ReflectiveMap, samples: F32, eps_b: float, counters: Counter[str] | None = None
) -> F32:
    """Light of one map at every pixel, float32 (H, W, 3), 0 on the background. The same bytes at any thread count.

    samples: `disc_samples`. eps_b ≥ 0: clamp on the squared distance, World units². counters: `light_evaluations` is added to.
    """
    pixels, view = pixels_of(gbuffer, world), seen.view
    total = np.zeros((len(pixels.rows), 3))
    _gather(
        pixels.receivers, seen.position, seen.normal, seen.flux,
        view.views.astype(np.float32), view.half.astype(np.float32), view.centre.astype(np.float32),
        view.origin.astype(np.float32), view.parallel, samples, np.float32(eps_b), total,
    )  # fmt: skip
    if counters is not None:
        counters["light_evaluations"] += len(pixels.rows) * len(samples)
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[pixels.rows] = total
    return image.reshape(*gbuffer.triangle.shape, 3)


@numba.njit(parallel=True, cache=True)
def _gather(  # type: ignore[no-untyped-def]
    pixels, map_position, map_normal, map_flux, views, half, centre, origin, parallel, samples, eps_b, out,
):  # fmt: skip
    """out (P, 3) float64 += Σ_i w_i f G_b Φ/π of the texels that the samples meet."""
    position, normal = pixels.position, pixels.normal
    for i in numba.prange(len(position)):
        frame = np.empty((3, 3), np.float32)
        if parallel:
            for c in range(3):
                frame[0, c] = views[0, c, 0] * position[i, 0] + views[0, c, 1] * position[i, 1] + views[0, c, 2] * position[i, 2]
        else:
            _frame(position[i] - origin, frame)
        weight = np.empty(3)
        for k in range(len(samples)):
            row, column = _texel(
                frame, samples[k, 0], samples[k, 1], samples[k, 2], views, half, centre, parallel, map_flux.shape[1]
            )
            if row < 0:
                continue
            dx = map_position[row, column, 0] - position[i, 0]
            dy = map_position[row, column, 1] - position[i, 1]
            dz = map_position[row, column, 2] - position[i, 2]
            r2 = dx * dx + dy * dy + dz * dz
            cx = normal[i, 0] * dx + normal[i, 1] * dy + normal[i, 2] * dz
            cy = -(map_normal[row, column, 0] * dx + map_normal[row, column, 1] * dy + map_normal[row, column, 2] * dz)
            if cx <= 0 or cy <= 0 or r2 <= SAFE_R2:
                continue
            g = samples[k, 3] / np.pi * cx * cy / (r2 * max(eps_b, r2))
            for c in range(3):
                weight[c] = g * map_flux[row, column, c]
            reflect(pixels, i, (dx, dy, dz), r2, weight, out)


@numba.njit(cache=True)
def _frame(d, frame):  # type: ignore[no-untyped-def]
    """Rows: unit d and two axes across it (Duff et al. 2017)."""
    length = np.sqrt(max(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], np.float32(1e-20)))
    x, y, z = d[0] / length, d[1] / length, d[2] / length
    sign = np.float32(1) if z >= 0 else np.float32(-1)
    a = -1 / (sign + z)
    b = x * y * a
    frame[0, 0], frame[0, 1], frame[0, 2] = x, y, z
    frame[1, 0], frame[1, 1], frame[1, 2] = 1 + sign * x * x * a, sign * b, -sign * x
    frame[2, 0], frame[2, 1], frame[2, 2] = b, sign + y * y * a, -y


@numba.njit(cache=True)
def _texel(frame, first, second, third, views, half, centre, parallel, resolution):  # type: ignore[no-untyped-def]
    """Row and column of the texel that a sample (its three offsets) falls on, row -1 outside the map."""
    tile = 0
    if parallel:
        s, t = frame[0, 0] + second, frame[0, 1] + third
    else:
        dx = first * frame[0, 0] + second * frame[1, 0] + third * frame[2, 0]
        dy = first * frame[0, 1] + second * frame[1, 1] + third * frame[2, 1]
        dz = first * frame[0, 2] + second * frame[1, 2] + third * frame[2, 2]
        depth = np.float32(-1)
        for k in range(len(views)):
            z = -(views[k, 2, 0] * dx + views[k, 2, 1] * dy + views[k, 2, 2] * dz)
            if z > depth:
                depth, tile = z, k
        if depth <= 0:
            return -1, 0
        s = (views[tile, 0, 0] * dx + views[tile, 0, 1] * dy + views[tile, 0, 2] * dz) / depth
        t = (views[tile, 1, 0] * dx + views[tile, 1, 1] * dy + views[tile, 1, 2] * dz) / depth
    column = int(np.floor(((s - centre[0]) / half[0] * np.float32(0.5) + np.float32(0.5)) * resolution))
    row = int(np.floor(((t - centre[1]) / half[1] * np.float32(0.5) + np.float32(0.5)) * resolution))
    if column < 0 or row < 0 or column >= resolution or row >= resolution:
        return -1, 0
    return tile * resolution + row, column
