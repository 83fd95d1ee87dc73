"""Layout of an evaluation folder: what jobs write and reports read.

DIR/
  evaluation.json              Evaluation: request, scenes, cells, references (below)
  results/<cell id>.json       one Result a cell
  images/<cell id>.exr         layers of the Frame (direct.*, indirect.*, beauty.*)
  references/<ref id>.exr      layers mean.*, variance.*, luminance_variance.Y, noise_sample.*, revealed.Y; n, spp
  index.html  assets/  results.csv  results.parquet      written by `reports.write`
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from reports.results import Result

State = Literal["queued", "running", "done", "failed", "cancelled"]


class SceneInfo(BaseModel):
    """What a report says of a scene. exposure: the scene's fixed one; fps: frames a second;
    aliasing: metrics of the box against the centre reference.
    """

    model_config = ConfigDict(extra="forbid")
    name: str
    hash: str
    needs: list[str] = []
    notes: list[str] = []
    triangles: int = 0
    exposure: float = 1.0
    fps: float = 24.0
    aliasing: dict[str, float | None] = {}


class Cell(BaseModel):
    """One render of the plan. `id` is file-name safe and unique in the evaluation; `error` is set when `state` is failed."""

    model_config = ConfigDict(extra="forbid")
    id: str
    scene: str
    method: str
    label: str
    settings: dict[str, Any]
    seed: int
    frame: int
    width: int
    height: int
    transport: str
    state: State = "queued"
    error: str | None = None


class ReferenceInfo(BaseModel):
    """One reference image of the evaluation; `noise` is the reached noise, `asked` the wanted one."""

    model_config = ConfigDict(extra="forbid")
    id: str
    scene: str
    frame: int
    transport: str
    pixel: Literal["centre", "box"]
    noise: float
    asked: float
    replicates: int
    spp: int
    seconds: float
    content_hash: str
    notes: list[str] = []


class Evaluation(BaseModel):
    """The whole of `evaluation.json`."""

    model_config = ConfigDict(extra="forbid")
    id: str
    created: str
    command: str = ""
    request: dict[str, Any]
    scenes: list[SceneInfo]
    cells: list[Cell]
    references: list[ReferenceInfo] = []


def read(folder: Path) -> tuple[Evaluation, dict[str, Result]]:
    """The evaluation and its results by cell id (cells that failed have none)."""
    evaluation = Evaluation.model_validate_json((folder / "evaluation.json").read_text())
    results = {}
    for cell in evaluation.cells:
        path = folder / "results" / f"{cell.id}.json"
        if path.is_file():
            results[cell.id] = Result.model_validate_json(path.read_text())
    return evaluation, results
