"""Irradiance records splatted on GL: twin of `renderers.transport.caching.splat`.

Tile lists as for all splats (`renderers.gl.splat`): each pixel adds the records in their order, in registers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl.gbuffer import ResidentGBuffer
from renderers.gl.programs import FOLDER
from renderers.gl.splat import splat
from renderers.scene.world import World

F32 = NDArray[np.float32]
Float = NDArray[np.floating]
KINDS = {"ward": 0, "shifted": 1, "tent": 2}


def splat_records(
    gbuffer: GBuffer | ResidentGBuffer,
    world: World,
    columns: tuple[Float, Float, Float, Float, Float, Float],
    a: float,
    weight: str = "ward",
    gradients: bool = True,
) -> tuple[F32, int]:
    """Σ w E' and Σ w of K records at accuracy a, float32 (H, W, 4), and how many (pixel, record) pairs were computed.

    columns: position, normal (K, 3), radius (K,), irradiance (K, 3), translation, rotation (K, 3, 3) [channel, component].
    weight: as in `transport.caching.weights`. The background is 0. Raises GLError.
    """
    position, normal, radius, irradiance, translation, rotation = columns
    count = len(position)
    payload = np.zeros((count, 8 if gradients else 2, 4), np.float32)
    payload[:, 0, :3], payload[:, 0, 3], payload[:, 1, :3] = normal, radius, irradiance
    if gradients:
        payload[:, 2:5, :3], payload[:, 5:8, :3] = translation, rotation
    defines = (f"KIND {KINDS[weight]}", *(("GRADIENTS",) if gradients else ()))
    snippet = (FOLDER / "records.glsl").read_text()
    return splat(
        gbuffer,
        world,
        position,
        a * radius,
        payload.reshape(count, payload.shape[1] * 4),
        snippet,
        {"accuracy": float(np.float32(a))},
        defines,
    )
