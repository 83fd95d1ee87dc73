"""Stable content hash of a scene: the same on every machine, process and Python version."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass

import numpy as np

from renderers.scene.model import Scene

IGNORED = ("name", "extras", "notes", "parameters")


def hash_of(scene: Scene) -> str:
    """SHA-256 (hex) of the scene's content; names, notes, extras and builder parameters don't count."""
    digest = hashlib.sha256()
    _feed(digest, scene)
    return digest.hexdigest()


def _feed(digest: hashlib._Hash, value: object) -> None:
    if is_dataclass(value):
        digest.update(f"<{type(value).__name__}>".encode())
        for item in fields(value):
            if item.name not in IGNORED:
                digest.update(item.name.encode())
                _feed(digest, getattr(value, item.name))
    elif isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        digest.update(f"[{array.dtype.str}{array.shape}]".encode())
        digest.update(array.tobytes())
    elif isinstance(value, tuple):
        digest.update(f"({len(value)}".encode())
        for entry in value:
            _feed(digest, entry)
    elif isinstance(value, bool | str) or value is None:
        digest.update(f"{type(value).__name__}:{value}".encode())
    elif isinstance(value, int | float | np.integer | np.floating):
        # 1 and 1.0 are the same number, whoever wrote it
        digest.update(f"n:{float(value).hex()}".encode())
    else:
        raise TypeError(f"can't hash {type(value).__name__}")
