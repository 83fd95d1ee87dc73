"""The G-buffer by ray casting: the same arrays as `renderers.gl.gbuffer.render_gbuffer`, without a GL context."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.raycast import caster_of
from renderers.transport.seen import seen_along

TILED_ROWS = 4


def cast_gbuffer(world: World, size: tuple[int, int], offset: tuple[float, float] = (0.5, 0.5)) -> GBuffer:
    """First hits of one ray a pixel. size is (width, height); offset is the sample's position in the pixel, in [0, 1)²."""
    width, height = size
    origins, directions = (a.reshape(-1, 3).astype(np.float32) for a in world.camera.rays(size, offset))
    hits = caster_of(world).first_hit(origins, directions, (TILED_ROWS, width))
    seen = seen_along(world, directions, hits)
    front = np.einsum("ij,ij->i", seen.geometric, seen.towards) > 0
    emits = front | world.materials.emits_both[seen.material]
    emission = np.where(emits[:, None], world.materials.emission[seen.material], 0)

    def image(values: Any, fill: int, dtype: Any, *channels: int) -> Any:
        flat = np.full((height * width, *channels), fill, dtype)
        flat[seen.ray] = values
        return flat.reshape(height, width, *channels)

    return GBuffer(
        position=image(seen.position, 0, np.float32, 3),
        normal=image(seen.normal, 0, np.float32, 3),
        base=image(seen.base, 0, np.float32, 3),
        emission=image(emission, 0, np.float32, 3),
        triangle=image(hits.triangle[seen.ray], -1, np.int32),
        material=image(seen.material, -1, np.int32),
        eye=world.camera.pose[:3, 3].copy(),
        offset=offset,
    )
