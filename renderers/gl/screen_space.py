"""Screen-space directional occlusion on GL, one full-screen pass each for the sky and the bounce. See `transport.screen_space`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import passes
from renderers.gl.context import context
from renderers.gl.gbuffer import ResidentGBuffer, on_gpu
from renderers.gl.programs import assign, program
from renderers.gl.upload import PAYLOAD
from renderers.scene.world import World, rotation_matrix

F32 = NDArray[np.float32]
UNIT = 4


def sky(gbuffer: GBuffer, world: World, pattern: F32, radius: float, bias: float) -> F32:
    """Light of the open sky reflected to the eye, float32 (H, W, 3). pattern: `sample_pattern`. Raises GLError."""
    if world.environment is None:
        return np.zeros((*gbuffer.triangle.shape, 3), np.float32)
    image, rotation = world.environment.image, rotation_matrix(world.environment.rotation)
    texels = np.zeros((1, 1, 3), np.float32) if image is None else image
    uniforms = {
        "sky_map": UNIT,
        "sky_image": image is not None,
        "sky_radiance": tuple(world.environment.radiance),
        # columns of the inverse rotation are rows of the rotation
        "world_to_sky": np.ascontiguousarray(rotation, np.float32).tobytes(),
    }
    return _pass(gbuffer, world, pattern, radius, bias, texels, uniforms, ())


def bounce(gbuffer: GBuffer, world: World, pattern: F32, radius: float, bias: float, senders: F32, eps_b: float) -> F32:
    """Light that blockers send, float32 (H, W, 3). senders (H, W, 3): radiance that leaves each pixel. Raises GLError."""
    area = np.pi * radius**2 / pattern.shape[1]
    return _pass(gbuffer, world, pattern, radius, bias, senders, {"sent_map": UNIT, "eps_b": eps_b, "area": area}, ("BOUNCE",))


def _pass(
    gbuffer: GBuffer | ResidentGBuffer, world: World, pattern: F32, radius: float, bias: float, texels: F32,
    uniforms: dict[str, Any], defines: tuple[str, ...],
) -> F32:  # fmt: skip
    shader = program("fullscreen.vert.glsl", "screen_space.frag.glsl", "", defines)
    texture, block = _texture(texels), context().buffer(np.ascontiguousarray(pattern, np.float32).tobytes())
    with on_gpu(gbuffer, world) as resident:
        size, tangent = resident.size, float(np.tan(world.camera.yfov / 2))
        target = passes.accumulator(size)
        resident.bind(shader)
        block.bind_to_storage_buffer(PAYLOAD)
        texture.use(UNIT)
        assign(
            shader,
            sample_count=pattern.shape[1],
            side=int(np.sqrt(len(pattern))),
            radius=radius,
            bias=bias,
            # columns of the inverse rotation are rows of the camera's axes
            world_to_camera=np.ascontiguousarray(world.camera.pose[:3, :3], np.float32).tobytes(),
            scale=(size[1] / (2 * tangent), -size[1] / (2 * tangent)),
            middle=(size[0] / 2, size[1] / 2),
            offset=resident.offset,
            **uniforms,
        )
        passes.draw_fullscreen(target, shader, "screen-space occlusion")
        image = passes.read_rgb(target.color_attachments[0])
        passes.release(target, *target.color_attachments, texture, block)
    return image


def _texture(array: F32) -> Any:
    height, width, _ = array.shape
    texels = np.concatenate([array, np.zeros((height, width, 1), np.float32)], axis=-1)
    return context().texture((width, height), 4, np.ascontiguousarray(texels, np.float32).tobytes(), dtype="f4")
