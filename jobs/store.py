"""The data folder: cached references, the exposure of each scene, and by default the queue's database and the artefacts."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

from jobs.files import write_text


class Store:
    """A folder, LUXMETER_HOME or ~/.local/share/luxmeter. Nothing is created before something is written."""

    def __init__(self, home: Path | None = None) -> None:
        self.home = home or Path(os.environ.get("LUXMETER_HOME") or Path.home() / ".local" / "share" / "luxmeter")

    @property
    def references(self) -> Path:
        """Folder of cached references."""
        return self.home / "references"

    @property
    def database(self) -> str:
        """URL of the queue's database: LUXMETER_DATABASE, or a file in this folder."""
        return os.environ.get("LUXMETER_DATABASE") or f"sqlite:///{self.home.resolve() / 'queue.sqlite'}"

    @property
    def artifacts(self) -> str:
        """URL of the artefact store: LUXMETER_STORE, or a folder in this one."""
        return os.environ.get("LUXMETER_STORE") or str(self.home.resolve() / "artifacts")

    def exposure(self, scene_hash: str) -> float | None:
        """The scene's exposure, None before its first full reference."""
        path = self._exposure_file(scene_hash)
        return float(json.loads(path.read_text())["exposure"]) if path.is_file() else None

    def keep_exposure(self, scene_hash: str, exposure: float) -> float:
        """Store the scene's exposure unless there is one already; returns the stored one."""
        if self.exposure(scene_hash) is None:
            write_text(self._exposure_file(scene_hash), json.dumps({"exposure": exposure}))
        return self.exposure(scene_hash) or exposure

    def check_writable(self) -> None:
        """Raises OSError where the data folder can't be written."""
        self.home.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self.home):
            pass

    def _exposure_file(self, scene_hash: str) -> Path:
        return self.home / "exposures" / f"{scene_hash}.json"
