"""G-buffer: what the camera sees in each pixel, by rasterisation at one sample a pixel.

Attachments (float32, row 0 on top): position xyz and a 1 where covered; shading normal turned to the viewer and ±1 for front
or back; base colour × texture; triangle and material as integers (exact to 2³¹). Nothing is culled.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import camera, passes
from renderers.gl.context import context, device
from renderers.gl.programs import assign, program
from renderers.gl.upload import Uploaded, srgb_table, upload
from renderers.scene.world import World

WRAP = {"repeat": 0, "clamp": 1, "mirror": 2}


@dataclass(frozen=True, eq=False)
class ResidentGBuffer:
    """A G-buffer kept on the GPU for later passes: moderngl textures, RGBA32F (position, normal, base) and RG32I (ids)."""

    world: World
    position: Any
    normal: Any
    base: Any
    ids: Any
    offset: tuple[float, float]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)."""
        return self.ids.size  # type: ignore[no-any-return]

    @property
    def eye(self) -> NDArray[np.float64]:
        """Camera position, float64 (3,)."""
        return self.world.camera.pose[:3, 3]

    def bind(self, target: Any) -> None:
        """Bind textures and tables for a program that includes `surface.glsl`."""
        for unit, (name, texture) in enumerate(
            {"position_map": self.position, "normal_map": self.normal, "base_map": self.base, "id_map": self.ids}.items()
        ):
            texture.use(unit)
            assign(target, **{name: unit})
        assign(target, eye=tuple(self.eye))
        upload(self.world).bind()

    def read(self) -> GBuffer:
        """The same as numpy arrays."""
        normal, ids = passes.read(self.normal), passes.read(self.ids)
        material = np.ascontiguousarray(ids[..., 1])
        return GBuffer(
            position=passes.read_rgb(self.position),
            normal=np.ascontiguousarray(normal[..., :3]),
            base=passes.read_rgb(self.base),
            emission=_emission(self.world, material, normal[..., 3] > 0),
            triangle=np.ascontiguousarray(ids[..., 0]),
            material=material,
            eye=self.eye.copy(),
            offset=self.offset,
        )

    def release(self) -> None:
        """Delete the textures."""
        for texture in (self.position, self.normal, self.base, self.ids):
            texture.release()


def render_gbuffer(world: World, size: tuple[int, int], offset: tuple[float, float] = (0.5, 0.5)) -> GBuffer:
    """First hits of the rays through (column + offset[0], row + offset[1]), as numpy arrays.

    size: (width, height). Raises GLError.
    """
    resident = render_resident(world, size, offset)
    try:
        return resident.read()
    finally:
        resident.release()


def render_resident(world: World, size: tuple[int, int], offset: tuple[float, float] = (0.5, 0.5)) -> ResidentGBuffer:
    """`render_gbuffer`, left on the GPU. The caller releases it. Raises GLError."""
    ctx, uploaded = context(), upload(world)
    position, normal, base = (ctx.texture(size, 4, dtype="f4") for _ in range(3))
    ids = ctx.texture(size, 2, dtype="i4")
    depth = passes.depth_target(size)
    target = passes.framebuffer([position, normal, base, ids], depth)
    black = (0.0, 0.0, 0.0, 0.0)
    passes.clear(target, black, black, black, (-1, -1, 0, 0), depth=0.0)
    shader = program("gbuffer.vert.glsl", "gbuffer.frag.glsl")
    clip = camera.world_to_clip(world, size, offset, zero_to_one=device().zero_to_one)
    assign(shader, clip_matrix=camera.column_major(clip), eye=tuple(world.camera.pose[:3, 3]), image=0, srgb=1)
    srgb_table().use(1)
    uploaded.bind()
    draw_runs(target, shader, world, uploaded)
    passes.release(target, depth)
    return ResidentGBuffer(world, position, normal, base, ids, offset)


def draw_runs(target: Any, shader: Any, world: World, uploaded: Uploaded) -> None:
    """Draw all triangles with `gbuffer.*.glsl` into the target's viewport, one call for each run of a texture."""
    assign(shader, window=target.viewport)
    vertices = uploaded.vertex_array(shader, "in_position", "in_normal", "in_uv")
    for first, count, texture in uploaded.runs:
        if texture >= 0:
            uploaded.textures[texture].use(0)
            wrap = world.textures[texture].wrap
            assign(shader, wrap=(WRAP[wrap[0]], WRAP[wrap[1]]))
        assign(shader, first_triangle=first, textured=texture >= 0)
        passes.draw(target, vertices, "gbuffer", depth=True, vertices=3 * count, first=3 * first)


@contextlib.contextmanager
def on_gpu(gbuffer: GBuffer | ResidentGBuffer, world: World) -> Iterator[ResidentGBuffer]:
    """The G-buffer as textures: itself when resident, else uploaded for the block."""
    if isinstance(gbuffer, ResidentGBuffer):
        yield gbuffer
        return
    resident = _uploaded_gbuffer(gbuffer, world)
    try:
        yield resident
    finally:
        resident.release()


def _uploaded_gbuffer(gbuffer: GBuffer, world: World) -> ResidentGBuffer:
    ctx, size = context(), gbuffer.size
    covered = gbuffer.covered.astype(np.float32)[..., None]

    def texture(array: NDArray[np.float32]) -> Any:
        return ctx.texture(size, 4, np.concatenate([array, covered], axis=-1).astype(np.float32).tobytes(), dtype="f4")

    ids = np.stack([gbuffer.triangle, gbuffer.material], axis=-1).astype(np.int32)
    return ResidentGBuffer(
        world, texture(gbuffer.position), texture(gbuffer.normal), texture(gbuffer.base),
        ctx.texture(size, 2, ids.tobytes(), dtype="i4"), gbuffer.offset,
    )  # fmt: skip


def _emission(world: World, material: NDArray[np.int32], front: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Radiance towards the viewer: the material's from its counter-clockwise front, or from both sides where it emits from both."""
    table = world.materials
    radiance = np.zeros((*material.shape, 3), np.float32)
    seen = material >= 0
    seen[seen] &= front[seen] | table.emits_both[material[seen]]
    radiance[seen] = table.emission[material[seen]]
    return radiance
