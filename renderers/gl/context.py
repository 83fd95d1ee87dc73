"""The process's one OpenGL context: created by pyrender on EGL, driven by moderngl."""

from __future__ import annotations

import ctypes
import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np

VERSION = 430
LOWER_LEFT, ZERO_TO_ONE = 0x8CA1, 0x935F


class GLError(RuntimeError):
    """OpenGL is missing, too old, used from a wrong thread, or reported an error in a named pass."""


@dataclass(frozen=True, eq=False)
class Device:
    """What the process draws with. `renderer` is that of the module `pyrender` and owns vertex data; `zero_to_one`: clip depth is
    [0, 1].

    `idle`: a framebuffer to bind before another one is deleted, since moderngl goes back to the bound one after making a new one.
    """

    ctx: Any
    pyrender: Any
    offscreen: Any
    idle: Any
    zero_to_one: bool
    owner: tuple[int, int]

    @property
    def renderer(self) -> Any:
        """pyrender's Renderer: uploads and deletes the meshes of a pyrender scene."""
        return self.offscreen._renderer


class _EGLLoader:
    """Function addresses of whatever EGL context is current, as moderngl wants them; needs neither GLX nor X11."""

    def __init__(self) -> None:
        self._address = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
        self._address.restype = ctypes.c_void_p
        self._address.argtypes = [ctypes.c_char_p]

    def load_opengl_function(self, name: str) -> int:
        return self._address(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self) -> _EGLLoader:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def release(self) -> None:
        pass


def context() -> Any:
    """The moderngl.Context of this process; objects dropped since the last call are deleted here.

    Raises GLError without OpenGL 4.3, and when called from another thread or a forked child than the one that made the context.
    """
    made = device()
    ctx = made.ctx
    if ctx.objects:
        made.idle.use()
    while ctx.objects:
        dropped = ctx.objects.popleft()
        # Those released by hand before they were dropped are queued as well, without a release of their own (Context.gc
        # stumbles on them).
        if hasattr(dropped, "release"):
            dropped.release()
    return ctx


def device() -> Device:
    """Context together with pyrender's renderer. Raises GLError as `context` does."""
    made = _create()
    if made.owner != (os.getpid(), threading.get_ident()):
        raise GLError("the OpenGL context belongs to another thread or process; render in the one that used it first")
    return made


def check(ctx: Any, pass_name: str) -> None:
    """Raise GLError naming the pass when OpenGL reported an error since the last check; llvmpipe then draws nothing, silently."""
    error = ctx.error
    if error != "GL_NO_ERROR":
        raise GLError(f"{pass_name}: {error}")


@cache
def _create() -> Device:
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    if not hasattr(np, "infty"):
        np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201 - pyrender 0.1.45 reads the name that numpy 2 removed
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # deprecations inside pyrender, PyOpenGL and pyglet, at import only
            import moderngl
            import pyglet

            pyglet.options["headless"] = True  # pyrender's viewer, which nothing here uses, would load the libraries of X11
            import pyrender
        with _version_asked():
            offscreen = pyrender.OffscreenRenderer(1, 1)
        offscreen._platform.make_current()
        loader = _EGLLoader()
        ctx = moderngl.create_context(require=VERSION, context=loader)  # type: ignore[arg-type]
    except Exception as error:
        raise GLError(
            f"no OpenGL {VERSION // 100}.{VERSION // 10 % 10} context through EGL ({error or type(error).__name__})"
        ) from error
    ctx.gc_mode = "context_gc"
    idle = ctx.framebuffer([ctx.texture((1, 1), 4)])
    return Device(ctx, pyrender, offscreen, idle, _use_zero_to_one(loader, ctx), (os.getpid(), threading.get_ident()))


@contextmanager
def _version_asked() -> Iterator[None]:
    """EGL is asked for OpenGL 4.3 instead of pyrender's 4.1. Mesa gives its newest version to both; NVIDIA gives what was asked."""
    from pyrender.platforms import egl

    egl._ensure_egl_loaded()  # before the import, which else takes the platform that another importer of PyOpenGL left
    from OpenGL import EGL

    create = EGL.eglCreateContext

    def created(display: Any, config: Any, share: Any, attributes: Any) -> Any:
        names, (major, minor) = list(attributes[::2]), divmod(VERSION // 10, 10)
        attributes[2 * names.index(EGL.EGL_CONTEXT_MAJOR_VERSION) + 1] = major
        attributes[2 * names.index(EGL.EGL_CONTEXT_MINOR_VERSION) + 1] = minor
        return create(display, config, share, attributes)

    with patch.object(EGL, "eglCreateContext", created):
        yield


def _use_zero_to_one(loader: _EGLLoader, ctx: Any) -> bool:
    """Clip depth [0, 1] where the driver has it: reversed floating-point depth then keeps its digits at every distance."""
    if ctx.version_code < 450 and "GL_ARB_clip_control" not in ctx.extensions:
        return False
    ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(loader.load("glClipControl"))(LOWER_LEFT, ZERO_TO_ONE)
    return True
