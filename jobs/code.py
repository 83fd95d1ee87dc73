"""Which code made a result: a hash of the renderers' sources and of the libraries that make pixels, and the versions in words."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import renderers

PIXEL_LIBRARIES = ("numpy", "numba", "mitsuba", "moderngl")
SHOWN = ("luxmeter", "numpy", "numba", "mitsuba", "moderngl", "pyrender", "embreex", "OpenEXR")
SOURCES = (".py", ".glsl")


@cache
def code_hash() -> str:
    """SHA-256 over every source file of `renderers` and the installed versions of numpy, numba, mitsuba and moderngl."""
    root = Path(renderers.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(p for p in root.rglob("*") if p.suffix in SOURCES):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode())
        digest.update(path.read_bytes())
    for library in PIXEL_LIBRARIES:
        digest.update(f"{library}=={installed(library)}\0".encode())
    return digest.hexdigest()


@cache
def versions() -> dict[str, str]:
    """Versions of luxmeter, Python and the libraries that matter for an image; without those that aren't installed."""
    found = {name: installed(name) for name in SHOWN}
    return {"python": platform.python_version()} | {name: text for name, text in found.items() if text}


def installed(name: str) -> str:
    """Version of an installed distribution, empty where it isn't installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
