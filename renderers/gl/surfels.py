"""Splats of surfels over one radius: deep screen space on GL. Twin of `renderers.transport.surfels.splat_surfels`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl.gather import LARGEST
from renderers.gl.gbuffer import ResidentGBuffer
from renderers.gl.programs import FOLDER
from renderers.gl.splat import splat
from renderers.scene.world import World

F32 = NDArray[np.float32]


def splat_surfels(
    gbuffer: GBuffer | ResidentGBuffer, world: World, positions: F32, normals: F32, intensities: F32, radius: float, eps_b: float
) -> tuple[F32, int]:
    """Light of N surfels within `radius`, float32 (H, W, 3), and the number of pairs that bring any. All (N, 3). Raises GLError."""
    payload = np.concatenate([normals, np.zeros((len(normals), 1), np.float32), intensities], axis=1)
    inverse_bound = min(1 / eps_b, LARGEST) if eps_b > 0 else LARGEST
    snippet = (FOLDER / "surfels.glsl").read_text()
    radii = np.full(len(positions), radius, np.float32)
    image, _ = splat(gbuffer, world, positions, radii, payload, snippet, {"inverse_bound": inverse_bound})
    return np.ascontiguousarray(image[..., :3]), int(image[..., 3].sum(dtype=np.float64))
