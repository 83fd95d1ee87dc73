"""Tasks: the pieces of work that child processes carry out, as plain data. Paths are relative to `folder`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from renderers import Transport


class FrameOutput(BaseModel):
    """Where one frame of a render goes."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    frame: int
    image: str
    result: str


class RenderTask(BaseModel):
    """Render consecutive frames of one scene with one method, settings and seed.

    settings_file, where given, holds the settings that a PilotTask chose. A frame is rendered `repeats` times, each
    time from a scene that nothing has been cached for; timings are medians, and belong to `run`. With a `store`, the URL of an
    artefact store, a render that it holds is taken from there.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    kind: Literal["render"] = "render"
    scene: str
    scene_name: str
    method: str
    label: str
    settings: dict[str, Any]
    settings_file: str | None = None
    seed: int
    size: tuple[int, int]
    repeats: int = 1
    outputs: tuple[FrameOutput, ...]
    run: str = ""
    store: str | None = None
    folder: Path = Path()


class PilotTask(BaseModel):
    """Turn a wanted rendering time into settings that state the work, so that renders stay pure functions of their settings."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    kind: Literal["pilot"] = "pilot"
    scene: str
    method: str
    settings: dict[str, Any]
    size: tuple[int, int]
    output: str
    folder: Path = Path()


class ReferenceTask(BaseModel):
    """Path-trace one image to a wanted noise, or until `max_seconds`.

    cache: folder of references on this machine; store: URL of the artefact store that shares them between machines. begin: first
    frame of the sequence, before which nothing was ever seen.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    kind: Literal["reference"] = "reference"
    id: str
    scene: str
    scene_name: str
    transport: Transport
    pixel: Literal["centre", "box"] = "centre"
    frame: int = 0
    begin: int = 0
    size: tuple[int, int]
    noise: float
    max_seconds: float | None = None
    image: str
    folder: Path = Path()
    cache: Path | None = None
    store: str | None = None


class ClaimTask(BaseModel):
    """Measure one published claim; the answer is its document."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    kind: Literal["claim"] = "claim"
    claim: str


AnyTask = RenderTask | PilotTask | ReferenceTask | ClaimTask
Task = Annotated[AnyTask, Field(discriminator="kind")]
