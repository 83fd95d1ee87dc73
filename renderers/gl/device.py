"""Which OpenGL device this machine offers."""

from __future__ import annotations

from functools import cache


@cache
def device_string() -> str:
    """GL_RENDERER of the device, such as `llvmpipe (LLVM 15.0.6, 256 bits)`."""
    from renderers.gl.context import context

    return str(context().info["GL_RENDERER"])
