"""Reflective shadow maps on GL: the map rasterised from the light, then one full-screen pass. Twin of `transport.reflective`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import camera, passes
from renderers.gl.context import context
from renderers.gl.gather import LARGEST
from renderers.gl.gbuffer import ResidentGBuffer, draw_runs, on_gpu
from renderers.gl.programs import assign, program
from renderers.gl.shadow import clip_matrix
from renderers.gl.upload import PAYLOAD, srgb_table, upload
from renderers.reflective import LightView, ReflectiveMap
from renderers.scene.world import World

F32 = NDArray[np.float32]


def render_map(world: World, view: LightView) -> tuple[F32, F32, NDArray[np.int32]]:
    """First surfaces that the light sees: position and base float32 (n · R, R, 3), triangle int32 (n · R, R), -1 for none.

    Raises GLError.
    """
    ctx, uploaded = context(), upload(world)
    size = (view.resolution, view.resolution * len(view.views))
    position, normal, base = (ctx.texture(size, 4, dtype="f4") for _ in range(3))
    ids, depth = ctx.texture(size, 2, dtype="i4"), passes.depth_target(size)
    target = passes.framebuffer([position, normal, base, ids], depth)
    black = (0.0, 0.0, 0.0, 0.0)
    passes.clear(target, black, black, black, (-1, -1, 0, 0), depth=0.0)
    shader = program("gbuffer.vert.glsl", "gbuffer.frag.glsl")
    assign(shader, eye=tuple(view.origin), image=0, srgb=1)
    srgb_table().use(1)
    uploaded.bind()
    for tile in range(len(view.views)):
        target.viewport = (0, tile * view.resolution, view.resolution, view.resolution)
        assign(shader, clip_matrix=camera.column_major(clip_matrix(view, tile)))
        draw_runs(target, shader, world, uploaded)
    found = passes.read_rgb(position), passes.read_rgb(base), np.ascontiguousarray(passes.read(ids)[..., 0])
    passes.release(target, position, normal, base, ids, depth)
    return found


def gather_map(gbuffer: GBuffer | ResidentGBuffer, world: World, seen: ReflectiveMap, samples: F32, eps_b: float) -> F32:
    """Light of one map at every pixel, float32 (H, W, 3), 0 on the background; samples: `disc_samples` (n, 4). Raises GLError."""
    ctx, view = context(), seen.view
    shader = program("fullscreen.vert.glsl", "reflective.frag.glsl")
    textures = [_texture(array) for array in (seen.position, seen.normal, seen.flux)]
    block = ctx.buffer(np.ascontiguousarray(samples, np.float32).tobytes())
    views = np.zeros((6, 3, 3), np.float32)
    views[: len(view.views)] = np.swapaxes(view.views, 1, 2)
    with on_gpu(gbuffer, world) as resident:
        target = passes.accumulator(resident.size)
        resident.bind(shader)
        block.bind_to_storage_buffer(PAYLOAD)
        for unit, (name, texture) in enumerate(zip(("map_position", "map_normal", "map_flux"), textures, strict=True), 4):
            texture.use(unit)
            assign(shader, **{name: unit})
        assign(
            shader,
            sample_count=len(samples),
            map_tiles=len(view.views),
            map_resolution=view.resolution,
            map_parallel=view.parallel,
            map_view=views.tobytes(),
            map_origin=tuple(view.origin),
            map_centre=tuple(view.centre),
            map_half=tuple(view.half),
            inverse_bound=min(1 / eps_b, LARGEST) if eps_b > 0 else LARGEST,
        )
        passes.draw_fullscreen(target, shader, "reflective shadow map")
        image = passes.read_rgb(target.color_attachments[0])
        passes.release(target, *target.color_attachments, *textures, block)
    return image


def _texture(array: F32) -> Any:
    height, width, _ = array.shape
    texels = np.concatenate([array, np.zeros((height, width, 1), np.float32)], axis=-1)
    return context().texture((width, height), 4, texels.tobytes(), dtype="f4")
