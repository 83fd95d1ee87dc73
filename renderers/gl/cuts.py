"""Splats of virtual lights whose supports are bounded by drops: forward light cuts on GL. Twin of `renderers.transport.splat`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl.gbuffer import ResidentGBuffer
from renderers.gl.programs import FOLDER
from renderers.gl.splat import splat
from renderers.scene.world import World

LARGEST = float(np.finfo(np.float32).max)


def splat_cuts(
    gbuffer: GBuffer | ResidentGBuffer,
    world: World,
    lights: NDArray[np.float32],
    spheres: tuple[NDArray[np.floating], NDArray[np.floating]],
    family: int,
    eps_b: float,
) -> tuple[NDArray[np.float32], int]:
    """Light of L VPLs within their supports, float32 (H, W, 3), and the number of (pixel, light) pairs that bring any.

    lights: rows of position, normal, intensity and support, (21, L), as `transport.splat.light_rows` makes them. spheres: centres
    (L, 3) and radii (L,) around the supports. family: `kernel` of its class in `transport.cuts`. eps_b ≥ 0: World units². Raises
    GLError.
    """
    inverse_bound = min(1 / eps_b, LARGEST) if eps_b > 0 else LARGEST
    image = splat(
        gbuffer,
        world,
        *spheres,
        np.ascontiguousarray(lights.T),
        (FOLDER / "cuts.glsl").read_text(),
        {"family": family, "inverse_bound": inverse_bound},
    )
    return np.ascontiguousarray(image[..., :3]), int(image[..., 3].sum(dtype=np.float64))
