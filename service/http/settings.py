"""How a server is set up: limits, probes, where it may be reached."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from jobs.store import Store

KIB, MIB, GIB = 2**10, 2**20, 2**30


@dataclass(frozen=True)
class ServerSettings:
    """Sizes in bytes, times in seconds. `hosts`: names that requests may be addressed to (None: any).

    require_token: refuse every request without one, even while no token exists. Rates are per client and refill evenly; 0 turns
    the limit off. A body must keep up `body_bytes_per_s` after the first `body_grace_s`.
    """

    home: Path = field(default_factory=lambda: Store().home)
    require_token: bool = False
    hosts: tuple[str, ...] | None = None
    max_body_bytes: int = 1 * MIB
    max_scene_bytes: int = 64 * MIB
    max_scene_nodes: int = 20_000
    max_scene_triangles: int = 2_000_000
    scene_memory_bytes: int = 2 * GIB
    scene_seconds: float = 10
    body_grace_s: float = 5
    body_bytes_per_s: int = 64 * KIB
    requests_per_s: float = 50
    request_burst: int = 200
    submissions_per_s: float = 2
    submission_burst: int = 30
    max_cells: int = 20_000
    max_streams: int = 100
    poll_s: float = 1.0
    probe_every_s: float = 600

    @property
    def scenes(self) -> Path:
        """Folder of uploaded scenes."""
        return self.home / "scenes"

    @property
    def thumbnails(self) -> Path:
        """Folder of cached previews."""
        return self.home / "thumbnails"
