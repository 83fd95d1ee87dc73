"""VPL gather on the CPU: the sum over all virtual point lights at every pixel. Twin of `renderers.gl.gather`.

    L(x) = Σ_n f_r(x; y_n → x → eye) · max(0, n_x·l) · max(0, -n_y·l) / max(ε_b, r²) · I_n            [· V(x, y_n)]

Laurent 2018, equations 2.19 and 4.2 (baseline instant radiosity, Keller 1997). All in World units, ε_b too.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import LAMBERT, World
from renderers.transport.brdf import Materials, materials_at
from renderers.transport.kernels import Receivers, add_visible, facing_pairs, gather_general, gather_lambert
from renderers.transport.raycast import OFFSET, RayCaster
from renderers.transport.threads import chunks, in_threads

F32 = NDArray[np.float32]
PIXELS, LIGHTS = 2048, 64


class Pixels(NamedTuple):
    """Covered pixels, flat: position, normal, geometric float32 (P, 3); view float64 (P, 3), unit; materials; rows int64 (P,)."""

    position: F32
    normal: F32
    geometric: F32
    view: NDArray[np.float64]
    materials: Materials
    rows: NDArray[np.intp]

    @property
    def receivers(self) -> Receivers:
        """The columns that kernels read."""
        return Receivers(self.position, self.normal, self.view, *self.materials)

    def only(self, index: NDArray[np.intp] | slice) -> Pixels:
        """The selected pixels, arrays contiguous."""
        return Pixels(
            np.ascontiguousarray(self.position[index]),
            np.ascontiguousarray(self.normal[index]),
            np.ascontiguousarray(self.geometric[index]),
            np.ascontiguousarray(self.view[index]),
            self.materials.rows(index),
            self.rows[index],
        )


def gather(
    gbuffer: GBuffer,
    world: World,
    positions: F32,
    normals: F32,
    intensities: F32,
    eps_b: float,
    caster: RayCaster | None = None,
    counters: Counter[str] | None = None,
) -> F32:
    """Light of L VPLs at every pixel, float32 (H, W, 3), 0 on the background. The same bytes at any thread count.

    positions, normals (unit), intensities: float32 (L, 3). eps_b ≥ 0: clamp on the squared distance, World units². With a caster
    each facing pair is tested for occlusion (exact), without one none is. counters: adds `light_evaluations` (pixels × lights)
    and `rays`.
    """
    pixels = pixels_of(gbuffer, world)
    lights = np.ascontiguousarray(np.concatenate([positions, normals, intensities], axis=1).T, np.float32)
    if caster is None:
        total, rays = _unoccluded(pixels, lights, np.float32(eps_b)), 0
    else:
        total, rays = _occluded(pixels, lights, np.float32(eps_b), caster)
    if counters is not None:
        counters["light_evaluations"] += len(pixels.rows) * len(positions)
        counters["rays"] += rays
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[pixels.rows] = total
    return image.reshape(*gbuffer.triangle.shape, 3)


def pixels_of(gbuffer: GBuffer, world: World) -> Pixels:
    """The covered pixels of a G-buffer with all that shading them needs."""
    rows = np.flatnonzero(gbuffer.covered)
    position = gbuffer.position.reshape(-1, 3)[rows]
    view = gbuffer.eye - position
    view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
    materials = materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows])
    geometric = world.normals_of(gbuffer.triangle.ravel()[rows]).astype(np.float32)
    return Pixels(position, gbuffer.normal.reshape(-1, 3)[rows], geometric, view, materials, rows)


def one_receiver() -> Receivers:
    """One pixel that kernels are compiled with."""
    point, three, one = np.zeros((1, 3), np.float32), np.zeros((1, 3)), np.ones(1)
    return Receivers(point, point, three, np.zeros(1, np.int32), three, three, one, one, one)


@cache
def warm_up(occluded: bool, glossy: bool) -> None:
    """Compile (or load from numba's cache) the kernels that `gather` will use; once a process."""
    receiver, lights, none, three = one_receiver(), np.zeros((9, 1), np.float32), np.float32(0), np.zeros((1, 3))
    point = receiver.position
    if occluded:
        pairs = np.zeros((1, 2), np.int32)
        facing_pairs(point, point, point, lights, 0, 1, none, pairs, point.copy(), point.copy())
        add_visible(*receiver, lights, none, pairs, np.ones(1, bool), three)
        return
    gather_lambert(point, point, lights, none, three)
    if glossy:
        gather_general(*receiver, lights, none, three)


def _unoccluded(pixels: Pixels, lights: F32, eps_b: np.float32) -> NDArray[np.float64]:
    total = np.zeros((len(pixels.rows), 3))
    diffuse = np.flatnonzero(pixels.materials.kind == LAMBERT)
    if len(diffuse):
        sums = np.zeros((len(diffuse), 3))
        gather_lambert(
            np.ascontiguousarray(pixels.position[diffuse]), np.ascontiguousarray(pixels.normal[diffuse]), lights, eps_b, sums
        )
        total[diffuse] = sums * pixels.materials.base[diffuse] / np.pi
    glossy = np.flatnonzero(pixels.materials.kind != LAMBERT)
    if len(glossy):
        p = pixels.only(glossy)
        sums = np.zeros((len(glossy), 3))
        gather_general(*p.receivers, lights, eps_b, sums)
        total[glossy] = sums
    return total


def _occluded(pixels: Pixels, lights: F32, eps_b: np.float32, caster: RayCaster) -> tuple[NDArray[np.float64], int]:
    """Each task owns some pixels and walks through all lights in order, so sums don't depend on threads."""

    def task(part: slice) -> tuple[NDArray[np.float64], int]:
        p = pixels.only(part)
        size = len(p.rows) * LIGHTS
        pairs = np.empty((size, 2), np.int32)
        origins, directions = np.empty((size, 3), np.float32), np.empty((size, 3), np.float32)
        reach = np.full(size, 1.0, np.float32)
        total, rays = np.zeros((len(p.rows), 3)), 0
        for batch in chunks(lights.shape[1], LIGHTS):
            n = facing_pairs(
                p.position, p.normal, p.geometric, lights, batch.start, batch.stop, np.float32(OFFSET), pairs, origins, directions
            )
            rays += n
            blocked = caster.occluded_unthreaded(origins[:n], directions[:n], reach[:n])
            add_visible(*p.receivers, lights, eps_b, pairs[:n], blocked, total)
        return total, rays

    parts = in_threads(task, chunks(len(pixels.rows), PIXELS))
    if not parts:
        return np.zeros((0, 3)), 0
    return np.concatenate([total for total, _ in parts]), sum(rays for _, rays in parts)
