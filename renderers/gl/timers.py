"""GL timer queries: GPU seconds of a pass, next to wall and CPU seconds."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Literal

from renderers.frame import Stopwatch, Timing
from renderers.gl.context import context

SOFTWARE = ("llvmpipe", "softpipe", "swrast", "SwiftShader")


def has_gpu() -> bool:
    """Whether the device is hardware. On software renderers a timer query measures CPU time, which `cpu_s` holds already."""
    return not any(name in context().info["GL_RENDERER"] for name in SOFTWARE)


@contextlib.contextmanager
def timed(watch: Stopwatch, name: str, stage: Literal["prepare", "render"] = "render") -> Iterator[None]:
    """Time GL work into `watch`: wall and CPU until the device has finished, GPU by a timer query (None on software renderers).

    Blocks can't be nested (GL has one elapsed-time query at a time).
    """
    ctx = context()
    ctx.finish()
    query = ctx.query(time=True) if has_gpu() else None
    wall, cpu = time.perf_counter(), time.process_time()
    with query if query is not None else contextlib.nullcontext():
        yield
    ctx.finish()
    gpu = None if query is None else query.elapsed * 1e-9
    watch.add(Timing(name, time.perf_counter() - wall, time.process_time() - cpu, gpu, stage=stage))
