"""Lookup of packed attenuation functions in a fragment shader: an index texture and a vertex texture (St-Amour 2004 §4.3).

The published fixed slots (`PenumbraSlots`) make every pixel pay for the longest function; in `PenumbraTextures` each has as many
vertices as it needs, found by a binary search. Twin of `renderers.transport.penumbra.lookup`, on surfaces too.
"""

from __future__ import annotations

from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gl import passes
from renderers.gl.context import context
from renderers.gl.programs import assign, program

ROW = 4096


class PenumbraTextures:
    """Functions of one pyramid on the GPU; a context manager that deletes the textures.

    size: (width, height) pixels. grid: u_0, v_0, pitch, tangents. span: near, far, World units. start int (width · height + 1,),
    depth and value float32 (M,), as in a penumbra deep shadow map.
    """

    def __init__(
        self,
        size: tuple[int, int],
        grid: tuple[float, float, float],
        span: tuple[float, float],
        start: NDArray[np.int64],
        depth: NDArray[np.float32],
        value: NDArray[np.float32],
    ) -> None:
        ctx = context()
        self._grid, self._span = grid, span
        index = np.stack([start[:-1], np.diff(start)], axis=1).astype(np.int32)
        self._index = ctx.texture(size, 2, index.tobytes(), dtype="i4")
        rows = max(-(-len(depth) // ROW), 1)
        packed = np.zeros((rows * ROW, 2), np.float32)
        packed[: len(depth), 0], packed[: len(depth), 1] = depth, value
        self._vertices = ctx.texture((ROW, rows), 2, packed.tobytes(), dtype="f4")

    def __enter__(self) -> PenumbraTextures:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._index.release()
        self._vertices.release()

    def hidden(
        self,
        points: NDArray[np.floating],
        *,
        bilinear: bool = True,
        normals: NDArray[np.floating] | None = None,
        lift: float = 0.0,
    ) -> NDArray[np.float32]:
        """Hidden share at points (H, W, 3) of the pyramid's frame, float32 (H, W); -1 outside of the pyramid. Raises GLError.

        normals (H, W, 3), same frame: points with one are read on their surface's plane, lifted by `lift`, the offset times the
        texel of the map; zeros in free space.
        """
        flags = [f"ROW {ROW}"] + ["BILINEAR"] * bilinear + ["NORMALS"] * (normals is not None)
        shader = program("fullscreen.vert.glsl", "penumbra.frag.glsl", "", tuple(flags))
        assign(shader, grid=self._grid, range=self._span)
        textures = {"index": self._index, "vertices": self._vertices}
        if normals is None:
            return _looked_up(points, shader, textures)
        assign(shader, lift=lift)
        surface = _of_vectors(normals)
        try:
            return _looked_up(points, shader, {**textures, "normals": surface})
        finally:
            surface.release()


class PenumbraSlots:
    """Functions of one pyramid in fixed slots, the published layout; a context manager that deletes the textures.

    slots: uint32 (3 groups, height, width, 4). grid, span: as for PenumbraTextures. Its lookup is bilinear.
    """

    def __init__(self, slots: NDArray[np.uint32], grid: tuple[float, float, float], span: tuple[float, float]) -> None:
        layers, height, width, _ = slots.shape
        self._grid, self._span, self._groups = grid, span, layers // 3
        self._slots = context().texture_array((width, height, layers), 4, np.ascontiguousarray(slots).tobytes(), dtype="u4")

    def __enter__(self) -> PenumbraSlots:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._slots.release()

    def hidden(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Hidden share at points (H, W, 3) of the pyramid's frame, float32 (H, W); -1 outside of the pyramid. Raises GLError."""
        shader = program("fullscreen.vert.glsl", "penumbra_slots.frag.glsl", "", (f"GROUPS {self._groups}",))
        assign(shader, grid=self._grid, range=self._span)
        return _looked_up(points, shader, {"slots": self._slots})


def _looked_up(points: NDArray[np.floating], shader: Any, textures: dict[str, Any]) -> NDArray[np.float32]:
    """Run a lookup shader once per point (H, W, 3), float32 (H, W)."""
    height, width = points.shape[:2]
    where = _of_vectors(points)
    target = passes.framebuffer([context().texture((width, height), 1, dtype="f4")])
    for unit, (name, texture) in enumerate({"points": where, **textures}.items()):
        texture.use(unit)
        assign(shader, **{name: unit})
    passes.draw_fullscreen(target, shader, "penumbra lookup")
    image = np.array(passes.read(target.color_attachments[0])[..., 0])
    passes.release(target, *target.color_attachments, where)
    return image


def _of_vectors(vectors: NDArray[np.floating]) -> Any:
    """A texture of float32 vectors (H, W, 3)."""
    height, width = vectors.shape[:2]
    four = np.zeros((height, width, 4), np.float32)
    four[..., :3] = vectors
    return context().texture((width, height), 4, four.tobytes(), dtype="f4")
