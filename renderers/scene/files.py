"""Bytes of scene files and of the files beside them: limited in size, never outside the scene's own folder."""

from __future__ import annotations

from pathlib import Path

from renderers.scene.model import SceneError

MAX_FILE_BYTES = 512 * 2**20


def read_limited(path: Path, limit: int = MAX_FILE_BYTES) -> bytes:
    """The bytes of a regular file of at most `limit` bytes. Raises SceneError."""
    try:
        size = path.stat().st_size
        if size > limit:
            raise SceneError(f"{path}: file: {size} bytes, more than the limit of {limit}")
        return path.read_bytes()
    except OSError as error:
        raise SceneError(f"{path}: file: {error.strerror}") from None


def sibling(folder: Path, name: str) -> Path | None:
    """The file called `name` in `folder`, or None for anything but the plain name of a regular file that is there."""
    plain = name not in ("", ".", "..") and not any(c in name for c in ":/\\\0")
    path = folder / name if plain else None
    return path if path is not None and not path.is_symlink() and path.is_file() else None
