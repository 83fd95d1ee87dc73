"""GLSL programs from the files in `shaders/`: a line `#include "name.glsl"` is replaced by that file, once per program."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from renderers.gl.context import context

FOLDER = Path(__file__).parent / "shaders"
INCLUDE = re.compile(r'^#include "([\w.]+)"$', re.MULTILINE)
SNIPPET = "snippet.glsl"


def source(name: str, snippet: str = "", defines: tuple[str, ...] = ()) -> str:
    """Complete GLSL text of `shaders/name`, with `#define X` for each name in `defines`.

    `#include "snippet.glsl"` stands for `snippet`.
    """
    seen: set[str] = set()

    def insert(match: re.Match[str]) -> str:
        file = match[1]
        if file in seen:
            return ""
        seen.add(file)
        return expand(snippet if file == SNIPPET else (FOLDER / file).read_text())

    def expand(text: str) -> str:
        return INCLUDE.sub(insert, text)

    head = ["#version 430", *(f"#define {d}" for d in defines)]
    return "\n".join(head) + "\n" + expand((FOLDER / name).read_text())


@cache
def program(vertex: str, fragment: str, snippet: str = "", defines: tuple[str, ...] = ()) -> Any:
    """Compiled moderngl.Program, one per argument list. Raises moderngl.Error with the compiler's message."""
    return context().program(
        vertex_shader=source(vertex, "", defines), fragment_shader=source(fragment, snippet, defines)
    )  # fmt: skip


@cache
def compute(name: str, snippet: str = "", defines: tuple[str, ...] = ()) -> Any:
    """Compiled moderngl.ComputeShader, one per argument list. Raises moderngl.Error with the compiler's message."""
    return context().compute_shader(source(name, snippet, defines))


def assign(target: Any, **uniforms: Any) -> None:
    """Set uniforms by name; numbers, tuples, or bytes for matrices. Names that the compiler removed as unused are passed over."""
    for name, value in uniforms.items():
        if name in target:
            if isinstance(value, bytes):
                target[name].write(value)
            else:
                target[name].value = value
