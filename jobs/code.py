"""Which code made a result: a hash of the renderers' sources and of the libraries that make pixels, and the versions in words."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import renderers

PIXEL_LIBRARIES = ("numpy", "numba", "mitsuba", "moderngl")
SHOWN = ("luxmeter", "numpy", "numba", "mitsuba", "moderngl", "pyrender", "embreex", "OpenEXR")
SOURCES = (".py", ".glsl")


def code_hash() -> str:
    """SHA-256 over the sources of `renderers` and of the modules LUXMETER_PLUGINS names, and the versions of PIXEL_LIBRARIES."""
    return _code_hash(os.environ.get("LUXMETER_PLUGINS", ""))


@cache
def _code_hash(plugins: str) -> str:
    root = Path(renderers.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(p for p in root.rglob("*") if p.suffix in SOURCES):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode())
        digest.update(path.read_bytes())
    for plugin in plugins.replace(",", " ").split():
        found = importlib.util.find_spec(plugin)
        if found is not None and found.origin is not None:
            digest.update(f"{plugin}\0".encode())
            digest.update(Path(found.origin).read_bytes())
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
