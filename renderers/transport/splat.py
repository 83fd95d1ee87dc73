"""Splatting of virtual lights with bounded supports on the CPU. Twin of `renderers.gl.splat` as `flc` calls it.

    L(x) = Σ_n s_n(α_n(x)) / μ_n · f_r(x; y_n → x → eye) · max(0, n_x·l) · max(0, -n_y·l) / max(ε_b, r²) · I_n      [· V(x, y_n)]

Laurent 2018, equation 4.26 and algorithm 3. All in World units, ε_b and the squared reaches of the levels too.
"""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import Materials
from renderers.transport.cuts import PARAMETERS, Family
from renderers.transport.gather import Pixels, pixels_of
from renderers.transport.raycast import OFFSET, RayCaster
from renderers.transport.splat_kernels import add_pairs, lit_pairs
from renderers.transport.splat_lambert import packed, splat_lambert
from renderers.transport.threads import in_threads
from renderers.transport.tiles import AREA, Tiles, tiles_of
from renderers.transport.vpl import Vpls

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
PAIRS = 1 << 16


def light_rows(vpls: Vpls, family: Family, marks: F64) -> F32:
    """VPLs and their levels as the kernels and the shader read them, float32 (9 + PARAMETERS, L).

    marks: level of each VPL (L,). Intensities are divided by the density of the level.
    """
    intensity = vpls.intensities / family.density(marks)[:, None]
    return np.ascontiguousarray(
        np.concatenate([vpls.positions.T, vpls.normals.T, intensity.T, family.parameters(marks)]), np.float32
    )


def splat(
    gbuffer: GBuffer,
    world: World,
    lights: F32,
    family: Family,
    eps_b: float,
    caster: RayCaster | None = None,
    counters: Counter[str] | None = None,
) -> F32:
    """Light of all VPLs within their supports, float32 (H, W, 3), 0 on the background. The same bytes at any thread count.

    lights: `light_rows`. eps_b ≥ 0: clamp on the squared distance, World units². With a caster each lit pair is tested for
    occlusion. counters: adds `light_evaluations` (pairs computed), `pixels_touched` (pairs that bring light) and `rays`.
    """
    pixels = pixels_of(gbuffer, world)
    tiles = tiles_of(pixels.rows, gbuffer.size[0], pixels.position, pixels.normal)
    work = np.zeros(3, np.int64)
    if caster is None and (pixels.materials.kind == LAMBERT).all():
        total = _fast(pixels, tiles, lights, family, np.float32(eps_b), work)
    else:
        total = _pairwise(pixels, tiles, lights, family, np.float32(eps_b), caster, work)
    if counters is not None:
        for name, amount in zip(("light_evaluations", "pixels_touched", "rays"), work, strict=True):
            counters[name] += int(amount)
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[pixels.rows] = total
    return image.reshape(*gbuffer.triangle.shape, 3)


@cache
def warm_up(kernel: int, pairwise: bool) -> None:
    """Compile (or load from numba's cache) the kernels that `splat` will use; once a process."""
    receivers, bounds, none = np.zeros((1, 6, AREA), np.float32), np.zeros((1, 9), np.float32), np.float32(0)
    lights = np.zeros((9 + PARAMETERS, 0), np.float32)
    if not pairwise:
        out, work = np.zeros((1, 3, AREA)), np.zeros((1, 2), np.int64)
        splat_lambert(kernel, receivers, np.array([0, 1], np.int32), bounds, bounds, *packed(lights), none, out, work)
        return
    pixel, plane, buffers = np.zeros((1, AREA), np.int32), np.zeros((1, 3, AREA), np.float32), _buffers()
    lit_pairs(kernel, receivers, plane, bounds, bounds, lights, 0, none, none, *buffers)
    point, three, one = np.zeros((1, 3), np.float32), np.zeros((1, 3)), np.zeros(1)
    materials = Materials(np.zeros(1, np.int32), three, three, one, one, one + 1)
    add_pairs(pixel, point, point, three, *materials, lights, buffers[0][:0], buffers[1][:0], np.zeros(0, bool), three.copy())


def _fast(pixels: Pixels, tiles: Tiles, lights: F32, family: Family, eps_b: np.float32, work: NDArray[np.int64]) -> F64:
    """Lambertian receivers, no occlusion: one multiplication by ρ/π at the end."""
    sums, done = np.zeros((len(tiles.pixel), 3, AREA)), np.zeros((len(tiles.first) - 1, 2), np.int64)
    splat_lambert(
        family.kernel, tiles.receivers, tiles.first, tiles.tile_bounds, tiles.block_bounds,
        *packed(lights), eps_b, sums, done,
    )  # fmt: skip
    work[:2] += done.sum(axis=0)
    total, filled = np.zeros((len(pixels.rows), 3)), tiles.pixel >= 0
    total[tiles.pixel[filled]] = sums.transpose(0, 2, 1)[filled]
    return np.asarray(total * pixels.materials.base / np.pi)


def _pairwise(
    pixels: Pixels, tiles: Tiles, lights: F32, family: Family, eps_b: np.float32, caster: RayCaster | None, work: NDArray[np.int64]
) -> F64:
    """Any BRDF, with or without occlusion. Each task owns a block of tiles and walks through all lights in order."""
    total = np.zeros((len(pixels.rows), 3))
    geometric = np.ascontiguousarray(pixels.geometric[np.maximum(tiles.pixel, 0)].transpose(0, 2, 1))

    def task(block: int) -> tuple[int, int, int]:
        own = slice(tiles.first[block], tiles.first[block + 1])
        pairs, values, origins, directions = buffers = _buffers()
        tested = touched = rays = j = 0
        while j < lights.shape[1]:
            n, evaluated, j = lit_pairs(
                family.kernel, tiles.receivers[own], geometric[own], tiles.tile_bounds[own], tiles.block_bounds[block : block + 1],
                lights, j, eps_b, np.float32(OFFSET), *buffers,
            )  # fmt: skip
            blocked = np.zeros(n, bool)
            if caster is not None:
                blocked = caster.occluded_unthreaded(origins[:n], directions[:n], np.ones(n, np.float32))
                rays += n
            add_pairs(
                tiles.pixel[own], pixels.position, pixels.normal, pixels.view, *pixels.materials,
                lights, pairs[:n], values[:n], blocked, total,
            )  # fmt: skip
            tested, touched = tested + evaluated, touched + n - int(blocked.sum())
        return tested, touched, rays

    done = in_threads(task, range(len(tiles.first) - 1))
    work += np.sum(done, axis=0, dtype=np.int64) if done else 0
    return total


def _buffers() -> tuple[NDArray[np.int32], F32, F32, F32]:
    """Room for PAIRS pairs (tile, place, light), their values, ray origins and directions."""
    rays = np.empty((2, PAIRS, 3), np.float32)
    return np.empty((PAIRS, 3), np.int32), np.empty(PAIRS, np.float32), rays[0], rays[1]
