"""The context, its errors, programs, timers and the cache of uploads."""

from __future__ import annotations

import gc
import threading

import numpy as np
import pytest

from renderers.frame import Stopwatch
from renderers.gl import context as gl
from renderers.gl import passes, timers, upload
from renderers.gl.device import device_string
from renderers.gl.gbuffer import render_gbuffer
from renderers.gl.programs import compute, source
from renderers.scene.load import load_scene

pytestmark = pytest.mark.gl


def test_one_context_a_process():
    assert gl.context() is gl.context()
    assert gl.context().version_code >= gl.VERSION
    assert device_string() == gl.context().info["GL_RENDERER"]


def test_egl_is_asked_for_the_version_needed(monkeypatch):
    gl.context()
    from OpenGL import EGL

    asked = []
    monkeypatch.setattr(EGL, "eglCreateContext", lambda *arguments: asked.append(arguments))
    recorder, pyrenders = EGL.eglCreateContext, np.array([0x3098, 4, 0x30FB, 1, 0x30FD, 1, 0x3038])
    with gl._version_asked():
        EGL.eglCreateContext("display", "config", None, pyrenders)
    assert EGL.eglCreateContext is recorder
    assert asked[0][:3] == ("display", "config", None)
    assert list(asked[0][3]) == [0x3098, 4, 0x30FB, 3, 0x30FD, 1, 0x3038]


def test_an_error_is_raised_by_the_name_of_its_pass():
    ctx = gl.context()
    gl.check(ctx, "before")
    target = passes.accumulator((4, 4))
    ctx.front_face = "cw"
    from OpenGL import GL, error

    with pytest.raises(error.GLError):
        GL.glEnable(0x7FFFFFFF)
    gl.check(ctx, "PyOpenGL took the error")
    ctx.mglo.enable_direct(0x7FFFFFFF)
    with pytest.raises(gl.GLError, match="a pass: GL_INVALID_ENUM"):
        gl.check(ctx, "a pass")
    passes.release(target, *target.color_attachments)


def test_another_thread_is_refused():
    gl.context()
    caught: list[BaseException] = []

    def work() -> None:
        try:
            gl.context()
        except gl.GLError as error:
            caught.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert "another thread" in str(caught[0])


def test_a_target_too_large_is_refused():
    texture = gl.context().texture((1, 1), 4, dtype="f4")

    class Huge:
        size = (1 << 20, 1)

    with pytest.raises(gl.GLError, match="exceeds"):
        passes.framebuffer([Huge()])
    texture.release()


def test_includes_are_inserted_once():
    text = source("direct.frag.glsl", defines=("X 1",))
    assert text.startswith("#version 430\n#define X 1\n")
    assert "#include" not in text
    assert text.count("struct Material {") == 1
    assert "my_snippet" in source("splat.comp.glsl", "vec4 my_snippet;")


def test_bad_glsl_says_so():
    import moderngl

    with pytest.raises(moderngl.Error, match="GLSL Compiler failed"):
        compute("splat.comp.glsl", "vec4 contribution(")


def test_uploads_are_bounded_and_follow_their_worlds():
    worlds = [load_scene("cornell-box").world() for _ in range(upload.CAPACITY + 2)]
    first = [render_gbuffer(w, (8, 6)).position.tobytes() for w in worlds]
    assert len(upload._uploads) <= upload.CAPACITY
    assert upload.upload(worlds[-1]) is upload.upload(worlds[-1])
    assert [render_gbuffer(w, (8, 6)).position.tobytes() for w in worlds] == first
    del worlds
    gc.collect()
    world = load_scene("cornell-box").world()
    upload.upload(world)
    assert len(upload._scene().mesh_nodes) == len(upload._uploads)


def test_timer_adds_passes_up():
    watch = Stopwatch()
    world = load_scene("cornell-box").world()
    for _ in range(2):
        with timers.timed(watch, "gbuffer", "prepare"):
            render_gbuffer(world, (16, 12))
    (timing,) = watch.timings
    assert (timing.name, timing.stage, timing.calls) == ("gbuffer", "prepare", 2)
    assert timing.wall_s > 0
    assert (timing.gpu_s is None) != timers.has_gpu()


def test_read_back_keeps_rows_and_types():
    data = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    texture = gl.context().texture((3, 2), 4, data.tobytes(), dtype="f4")
    assert np.array_equal(passes.read(texture), data)
    assert np.array_equal(passes.read_rgb(texture), data[..., :3])
    texture.release()
