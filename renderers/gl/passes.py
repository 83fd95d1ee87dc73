"""What every pass shares: float targets, full-screen drawing, additive accumulation, read-back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gl.context import GLError, check, context, device

COLOR, DEPTH, TEXTURE_2D, FLOAT, DEPTH_COMPONENT, DEPTH_COMPONENT32F = 0x1800, 0x1801, 0x0DE1, 0x1406, 0x1902, 0x8CAC


def depth_target(size: tuple[int, int]) -> Any:
    """32-bit floating-point depth texture (width, height); moderngl by itself makes 24-bit integer ones."""
    from OpenGL import GL

    texture = context().depth_texture(size)
    GL.glBindTexture(TEXTURE_2D, texture.glo)
    GL.glTexImage2D(TEXTURE_2D, 0, DEPTH_COMPONENT32F, *size, 0, DEPTH_COMPONENT, FLOAT, None)
    return texture


def framebuffer(colors: list[Any], depth: Any = None) -> Any:
    """Framebuffer over the given textures. Raises GLError when their size exceeds what the device can draw to."""
    ctx = context()
    limit = min(ctx.info["GL_MAX_TEXTURE_SIZE"], *ctx.info["GL_MAX_VIEWPORT_DIMS"])
    if max(colors[0].size) > limit:
        raise GLError(f"a target of {colors[0].size} exceeds this device's {limit} pixels")
    return ctx.framebuffer(colors, depth)


def clear(target: Any, *values: tuple[float, float, float, float] | tuple[int, int, int, int], depth: float | None = None) -> None:
    """Clear each colour attachment to its own value, integers to integer ones (glClear can't mix them), and depth if asked."""
    from OpenGL import GL

    target.use()
    for index, value in enumerate(values):
        if isinstance(value[0], int):
            GL.glClearBufferiv(COLOR, index, np.array(value, np.int32))
        else:
            GL.glClearBufferfv(COLOR, index, np.array(value, np.float32))
    if depth is not None:
        GL.glClearBufferfv(DEPTH, 0, np.array([depth], np.float32))


def accumulator(size: tuple[int, int]) -> Any:
    """Framebuffer with one RGBA32F texture (width, height), cleared to zero, for additive passes."""
    target = framebuffer([context().texture(size, 4, dtype="f4")])
    clear(target, (0.0, 0.0, 0.0, 0.0))
    return target


def draw(target: Any, geometry: Any, pass_name: str, *, add: bool = False, depth: bool = False, **call: Any) -> None:
    """Run one pass with its whole state set anew: additive blending or replacing, reversed depth test or none, no culling."""
    import moderngl

    ctx = context()
    target.use()
    ctx.enable_only((moderngl.BLEND if add else 0) | (moderngl.DEPTH_TEST if depth else 0))
    ctx.blend_func = moderngl.ONE, moderngl.ONE
    ctx.blend_equation = moderngl.FUNC_ADD
    ctx.depth_func = ">"
    # The picture is upside down in GL's window, so counter-clockwise triangles arrive clockwise.
    ctx.front_face = "cw"
    geometry.render(**call)
    check(ctx, pass_name)


def draw_fullscreen(target: Any, program: Any, pass_name: str, *, add: bool = False) -> None:
    """Run a fragment program once per pixel (vertex shader `fullscreen.vert.glsl`)."""
    import moderngl

    draw(target, context().vertex_array(program, []), pass_name, add=add, mode=moderngl.TRIANGLES, vertices=3)


def read(texture: Any) -> NDArray[Any]:
    """Texels as (H, W, components), float32 or int32 as stored, row 0 on top (see package docstring)."""
    width, height = texture.size
    dtype = {"f4": np.float32, "i4": np.int32}[texture.dtype]
    return np.frombuffer(texture.read(), dtype).reshape(height, width, texture.components)


def read_rgb(texture: Any) -> NDArray[np.float32]:
    """First three components of a float texture, float32 (H, W, 3), contiguous."""
    return np.ascontiguousarray(read(texture)[..., :3])


def release(target: Any, *textures: Any) -> None:
    """Delete a framebuffer, and the given textures with it."""
    device().idle.use()
    target.release()
    for texture in textures:
        texture.release()
