"""The covered pixels of a G-buffer as receivers of photon light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.brdf import Materials, materials_at

F64 = NDArray[np.float64]


class Pixels(NamedTuple):
    """position, normal (shading, turned to the viewer), geometric, view: float64 (P, 3); materials; row (P,): flat pixel index."""

    position: F64
    normal: F64
    geometric: F64
    view: F64
    materials: Materials
    row: NDArray[np.intp]

    def image(self, gbuffer: GBuffer, values: F64) -> F64:
        """Values (P, 3) at their pixels, float64 (H, W, 3), 0 on the background."""
        image = np.zeros((gbuffer.triangle.size, 3))
        image[self.row] = values
        return image.reshape(*gbuffer.triangle.shape, 3)


def gatherers(world: World, gbuffer: GBuffer) -> Pixels:
    """All covered pixels."""
    rows = np.flatnonzero(gbuffer.covered)
    position = gbuffer.position.reshape(-1, 3)[rows].astype(np.float64)
    view = gbuffer.eye - position
    view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
    materials = materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows])
    normal = gbuffer.normal.reshape(-1, 3)[rows].astype(np.float64)
    return Pixels(position, normal, world.face_normals[gbuffer.triangle.ravel()[rows]], view, materials, rows)
