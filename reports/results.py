"""One Result: (scene, frame, size, method, settings, seed) → metrics, costs, hashes. The content of `result.json`."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict

NOT_DETERMINISTIC = "determinism failure"  # how a note begins that says that equal questions got different answers


class Result(BaseModel):
    """One row. `metrics` holds `matched` and `full` (each metric id → number), and is empty before the comparison.

    `noise_floor`: metrics that the reference's own noise alone produces, against itself, keyed like `metrics`.
    `timings` are `Timing`s as dicts, measured in `run` (an evaluation's run; empty outside one);
    `device`: gl, cpu, threads, mitsuba; `label` tells settings of one method apart in tables.
    """

    model_config = ConfigDict(extra="forbid")

    scene: str
    scene_hash: str
    method: str
    label: str
    settings: dict[str, Any]
    settings_hash: str
    seed: int
    frame: int
    width: int
    height: int
    transport: str
    metrics: dict[str, dict[str, float | None]] = {}
    noise_floor: dict[str, dict[str, float | None]] = {}
    timings: list[dict[str, Any]] = []
    counters: dict[str, int] = {}
    approximations: list[str] = []
    notes: list[str] = []
    frame_hash: str = ""
    peak_rss_bytes: int = 0
    device: dict[str, str] = {}
    versions: dict[str, str] = {}
    run: str = ""
    started: str = ""
    finished: str = ""

    @property
    def seconds(self) -> float:
        """Wall seconds of the `render` stage (preparation and warm-up excluded)."""
        return float(sum(t["wall_s"] for t in self.timings if t["stage"] == "render"))
