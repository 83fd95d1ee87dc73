"""Splats of virtual lights whose supports are bounded by drops: forward light cuts on GL. Twin of `renderers.transport.splat`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl.gbuffer import ResidentGBuffer, render_gbuffer
from renderers.gl.programs import FOLDER
from renderers.gl.splat import is_diffuse, splat
from renderers.scene.world import World

LARGEST = float(np.finfo(np.float32).max)
# Rows of `light_rows` in the order of the payload: three numbers and one of the shape, three times; ends and shape; shape.
ORDER = [0, 1, 2, 11, 3, 4, 5, 12, 6, 7, 8, 13, 9, 10, 14, 15, 16, 17, 18, 19, 20]
# Payload (floats) that a family reads.
WIDTHS = (16, 21, 16, 16)
_COMPILED: set[tuple[int, bool]] = set()


def splat_cuts(
    gbuffer: GBuffer | ResidentGBuffer,
    world: World,
    lights: NDArray[np.float32],
    spheres: tuple[NDArray[np.floating], NDArray[np.floating]],
    family: int,
    eps_b: float,
) -> tuple[NDArray[np.float32], int, int]:
    """Light of L VPLs within their supports, float32 (H, W, 3); how many (pixel, light) pairs were computed, and bring any.

    lights: rows of position, normal, intensity and support, (21, L), as `transport.splat.light_rows` makes them. spheres: centres
    (L, 3) and radii (L,) around the supports. family: `kernel` of its class in `transport.cuts`. eps_b ≥ 0: World units². Raises
    GLError.
    """
    inverse_bound = min(1 / eps_b, LARGEST) if eps_b > 0 else LARGEST
    image, computed = splat(
        gbuffer,
        world,
        *spheres,
        lights[ORDER[: WIDTHS[family]]].T,
        (FOLDER / "cuts.glsl").read_text(),
        {"inverse_bound": inverse_bound},
        (f"FAMILY {family}",),
    )
    return np.ascontiguousarray(image[..., :3]), computed, int(image[..., 3].sum(dtype=np.float64))


def warm_up(world: World, family: int) -> None:
    """Compile the shaders that `splat_cuts` will use, by splatting one light; once a process and family.

    llvmpipe compiles anew for textures whose sides are powers of two, so the picture's aren't.
    """
    key = family, is_diffuse(world)
    if key not in _COMPILED:
        light, sphere = np.zeros((len(ORDER), 1), np.float32), (np.zeros((1, 3)), np.ones(1))
        splat_cuts(render_gbuffer(world, (3, 3)), world, light, sphere, family, 0.0)
        _COMPILED.add(key)
