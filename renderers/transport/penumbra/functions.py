"""A finished penumbra deep shadow map: a pyramid and one packed attenuation function per pixel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.transport.penumbra.lookup import evaluate
from renderers.transport.penumbra.pyramid import Pyramid

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
VERSION = 2


class PenumbraFileError(ValueError):
    """A file that is no penumbra deep shadow map, or one of another version."""


@dataclass(frozen=True, eq=False)
class PenumbraMap:
    """Functions of all pixels, one after another (St-Amour 2004 §4.3, linear encoding): that of pixel (column, row) has the
    vertices start[row · width + column] … of depth and value.

    samples: light points it was built from. texel: tangent pitch of the coarsest shadow map times the texels that one stands for to
    each side (1/2; 3/2 for the published walk); what surfaces are lifted by. start int64 (width · height + 1,); depth float32 (M,),
    World units along the pyramid's axis, not falling within a function; value float32 (M,), hidden share in [0, 1].
    """

    pyramid: Pyramid
    samples: int
    texel: float
    start: NDArray[np.int64]
    depth: F32
    value: F32

    @property
    def bytes(self) -> int:
        """Size with 8 bytes a vertex and 4 a pixel, as the source counts."""
        return 8 * len(self.depth) + 4 * (len(self.start) - 1)

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        return self.start.nbytes + self.depth.nbytes + self.value.nbytes

    def hidden(
        self,
        points: ArrayLike,
        filter: Literal["bilinear", "nearest"] = "bilinear",
        normals: ArrayLike | None = None,
        offset: float = 0.0,
    ) -> F32:
        """Share of the light that is hidden from World points (P, 3), float32 (P,) in [0, 1]; -1 where the pyramid does not reach.

        Any point may be asked for, on a surface or not: moving objects receive shadows without having been there at construction.
        normals (P, 3), World, turned to the side that is lit: geometric normals where the points lie on surfaces. With an offset
        they are read on the surface's plane, lifted so many times as far as it takes a plane not to hide itself without a slope
        bias.
        """
        p = self.pyramid
        local = np.ascontiguousarray(p.local(points).reshape(-1, 3))
        turned = np.zeros_like(local)
        if normals is not None and offset:
            turned[:] = np.asarray(normals, np.float64).reshape(-1, 3) @ p.rotation.T
        out = np.empty(len(local), np.float32)
        window = np.array([p.low[0], p.low[1], p.pitch, p.near, p.far, offset * self.texel])
        evaluate(local, turned, window, p.width, p.height, self.start, self.depth, self.value, filter == "bilinear", out)
        return out

    def save(self, path: Path | str) -> None:
        """Write a compressed .npz of this format's VERSION; the same bytes for the same map."""
        p = self.pyramid
        grid = np.array([*p.low, p.pitch, p.near, p.far, self.texel])
        with Path(path).open("wb") as file:
            np.savez_compressed(
                file, format=np.array(f"penumbra-deep-shadow-map/{VERSION}"), apex=p.apex, rotation=p.rotation, grid=grid,
                shape=np.array([p.width, p.height, self.samples]), start=self.start, depth=self.depth, value=self.value,
            )  # fmt: skip


def load(path: Path | str) -> PenumbraMap:
    """Read what `PenumbraMap.save` wrote. Raises PenumbraFileError, or OSError where the file can't be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            parts = {name: file[name] for name in file.files}
    except (ValueError, EOFError) as error:
        raise PenumbraFileError(f"{path}: not a penumbra deep shadow map") from error
    kind, _, version = str(parts.get("format", "")).partition("/")
    if kind != "penumbra-deep-shadow-map":
        raise PenumbraFileError(f"{path}: not a penumbra deep shadow map")
    if version != str(VERSION):
        raise PenumbraFileError(f"{path}: version {version}, this program reads {VERSION}")
    low_u, low_v, pitch, near, far, texel = (float(x) for x in parts["grid"])
    width, height, samples = (int(x) for x in parts["shape"])
    pyramid = Pyramid(parts["apex"], parts["rotation"], (low_u, low_v), pitch, width, height, near, far)
    return PenumbraMap(pyramid, samples, texel, parts["start"], parts["depth"], parts["value"])
