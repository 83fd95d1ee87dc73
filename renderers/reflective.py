"""What one light sees first: the texels of a reflective shadow map, each of which reflects light as a small source.

Filled by GL (`renderers.gl.reflective`) or by ray casting (`renderers.transport.reflective`), with the same arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LightView:
    """A light as a camera of one or more square tiles, `resolution` texels wide, on top of one another.

    views (n, 3, 3): World to tile, a tile looks along -Z. half (2,): a parallel tile's half extent, else tangents of half angles;
    centre (2,): middle of a parallel tile, else 0. depth: range along -Z of a parallel tile. origin, axis (3,): the light and the
    way it travels. intensity (3,): W/sr × scale², of an area sample times the cosine at its side; of a directional light W/m².
    """

    kind: Literal["point", "spot", "directional", "area"]
    origin: F64
    axis: F64
    intensity: F64
    cosines: tuple[float, float]
    views: F64
    half: F64
    centre: F64
    depth: tuple[float, float]
    resolution: int

    @property
    def parallel(self) -> bool:
        """Whether all rays have one direction."""
        return self.kind == "directional"

    def plane(self) -> F64:
        """Texel centres in a tile's plane, in units of its half extent, float64 (R, R, 2) of (x, y)."""
        at = (np.arange(self.resolution) + 0.5) / self.resolution * 2 - 1
        return np.stack(np.meshgrid(at, at), axis=-1)

    def rays(self) -> tuple[F64, F64]:
        """Origins and unit directions of the rays through texel centres, float64 (n · R, R, 3) each."""
        across = self.plane() * self.half + self.centre
        if self.parallel:
            start = np.concatenate([across, np.full((*across.shape[:2], 1), -self.depth[0])], axis=-1)
            origins = np.concatenate([start @ view for view in self.views])
            return origins, np.broadcast_to(self.axis / np.linalg.norm(self.axis), origins.shape)
        local = np.concatenate([across, np.full((*across.shape[:2], 1), -1.0)], axis=-1)
        directions = np.concatenate([local @ view for view in self.views])
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.origin, directions.shape), directions

    def emitted(self, directions: F64) -> F64:
        """Power per measure of rays, (..., 3): W/sr × scale² along unit directions, W/m² when parallel."""
        cosine = directions @ self.axis
        shape = np.ones_like(cosine)
        if self.kind == "area":
            shape = np.maximum(cosine, 0)
        if self.kind == "spot":
            inner, outer = self.cosines
            shape = np.clip((cosine - outer) / max(inner - outer, 1e-6), 0, 1) ** 2
        return np.asarray(shape[..., None] * self.intensity)


@dataclass(frozen=True, eq=False)
class ReflectiveMap:
    """A light's view with what its texels reflect.

    position, normal (geometric, of the lit side), flux: float32 (n · R, R, 3). flux: albedo × `LightView.emitted`, reflected power
    per measure; 0 where the light sees nothing.
    """

    view: LightView
    position: F32
    normal: F32
    flux: F32
