"""Gather from virtual point lights, none of them shadow-tested: every pixel sums over every light.

    L(x) = Σ_n f_r(x; y_n → x → eye) · max(0, n_x·l) · max(0, -n_y·l) / max(eps_b, r²) · I_n,     l = (y_n - x) / r

Lights go through a uniform block in batches of at most 64 KiB, whose passes add up in RGBA32F; a pixel's order of summation
is fixed, so the bytes don't depend on threads. A World of Lambert materials alone takes the fast path: one multiplication by
base / π at the end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import passes
from renderers.gl.context import context
from renderers.gl.gbuffer import ResidentGBuffer, on_gpu
from renderers.gl.programs import assign, program
from renderers.scene.world import LAMBERT, World

BATCH = 65536 // 48
LARGEST = float(np.finfo(np.float32).max)


def gather(
    gbuffer: GBuffer | ResidentGBuffer,
    world: World,
    positions: NDArray[np.floating],
    normals: NDArray[np.floating],
    intensities: NDArray[np.floating],
    eps_b: float,
) -> NDArray[np.float32]:
    """Radiance towards the eye, float32 (H, W, 3), from N lights: positions, unit normals, intensities (N, 3), all in World units.

    eps_b: bound on r² in normalised units², ≥ 0; lights nearer than r² = 1e-20 are skipped. Raises ValueError on eps_b < 0,
    GLError.
    """
    if eps_b < 0:
        raise ValueError(f"eps_b must not be negative, got {eps_b}")
    diffuse = bool(np.all(world.materials.kind[np.unique(world.material)] == LAMBERT))
    shader = program("fullscreen.vert.glsl", "gather.frag.glsl", "", (f"BATCH {BATCH}", *(() if diffuse else ("FULL_BRDF",))))
    lights = _packed(positions, normals, intensities)
    inverse_bound = min(1.0 / eps_b, LARGEST) if eps_b > 0 else LARGEST
    block = context().buffer(reserve=BATCH * 48)
    with on_gpu(gbuffer, world) as resident:
        target = passes.accumulator(resident.size)
        for start in range(0, len(lights), BATCH):
            batch = lights[start : start + BATCH]
            block.write(batch.tobytes())
            block.bind_to_uniform_block(0)
            resident.bind(shader)
            assign(shader, count=len(batch), inverse_bound=inverse_bound)
            passes.draw_fullscreen(target, shader, "gather", add=True)
        image = passes.read_rgb(target.color_attachments[0])
        passes.release(target, *target.color_attachments, block)
    return image


def _packed(
    positions: NDArray[np.floating], normals: NDArray[np.floating], intensities: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Lights as std140 rows: position and red, normal and green, unused and blue."""
    packed = np.zeros((len(positions), 12), np.float32)
    packed[:, 0:3], packed[:, 4:7] = positions, normals
    packed[:, [3, 7, 11]] = intensities
    return packed
