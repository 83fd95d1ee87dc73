"""Previews of scenes: ray cast once in a limited child process, then kept as PNG files."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable
from pathlib import Path

from jobs.code import code_hash
from jobs.files import whole
from service.http.limited import Refused, run
from service.http.problems import Problem
from service.http.settings import GIB, ServerSettings

SECONDS, MEMORY, WAIT_S = 30, 4 * GIB, 120


class Thumbnails:
    """A folder of PNG files, named by a hash of the scene's name and of the code that draws it."""

    def __init__(self, settings: ServerSettings) -> None:
        self.settings = settings
        self._one = threading.Lock()

    def path(self, scene: str) -> Path:
        """The scene's preview, drawn now if need be. Raises Problem where it can't be drawn."""
        path = self._file(scene)
        if path.is_file():
            return path
        if not self._one.acquire(timeout=WAIT_S):
            raise Problem("unavailable", "other previews are being drawn", {"retry-after": "10"})
        try:
            if not path.is_file():
                with whole(path) as temporary:
                    run("service.http.drawing", [scene, str(temporary)], SECONDS, MEMORY)
        except Refused as error:
            raise Problem("not-found", f"{scene} has no preview: {error}") from None
        finally:
            self._one.release()
        return path

    def drawn(self, scenes: Iterable[str]) -> set[str]:
        """Those of the scenes whose previews are there."""
        return {scene for scene in scenes if self._file(scene).is_file()}

    def _file(self, scene: str) -> Path:
        key = hashlib.sha256(f"{scene}\0{code_hash()}".encode()).hexdigest()
        return self.settings.thumbnails / f"{key[:32]}.png"
