"""Documents that the HTTP interface answers with."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from jobs.request import EvaluationRequest
from reports.change import Comparison
from reports.folder import Cell, State
from reports.results import Result
from reports.runs import RunInfo
from service.http.queue import ENDED, Status
from service.http.uploads import UploadedScene


class Progress(BaseModel):
    """Pieces of work: references, renders, comparisons, the report."""

    done: int
    total: int


class Links(BaseModel):
    """Where to go from an evaluation. `report` is empty until there is one."""

    self: str
    page: str
    events: str
    results: str
    report: str | None = None


class EvaluationSummary(BaseModel):
    """An evaluation without its cells."""

    id: str
    state: State
    created: str
    finished: str | None = None
    request: EvaluationRequest
    progress: Progress
    error: str | None = None
    links: Links


class EvaluationView(EvaluationSummary):
    """An evaluation with one cell per scene × method configuration × seed × frame."""

    cells: list[Cell]


class EvaluationPage(BaseModel):
    """A page of evaluations, newest first. `next_cursor` is null on the last one."""

    items: list[EvaluationSummary]
    next_cursor: str | None = None


class EventPage(BaseModel):
    """Events after the asked one, in order; each has an increasing `seq`."""

    events: list[dict[str, Any]]
    state: State


class ResultList(BaseModel):
    """Results of an evaluation, in the order of its cells."""

    id: str
    state: State
    results: list[Result]


class ClaimView(BaseModel):
    """How a method meets one need of a scene."""

    support: Literal["exact", "approximated", "refused"]
    how: str


class MethodView(BaseModel):
    """A method; `settings` is the JSON schema of its settings."""

    name: str
    title: str
    source: str
    transport: str
    settings: dict[str, Any]
    claims: dict[str, ClaimView]


class MethodList(BaseModel):
    """All methods by name."""

    items: list[MethodView]


class SceneView(BaseModel):
    """A scene that evaluations may name. `parameters`: defaults, changed by writing `NAME:key=value,…`."""

    name: str
    kind: Literal["built-in", "folder", "uploaded"]
    description: str
    parameters: dict[str, str] = {}
    thumbnail: str
    upload: UploadedScene | None = Field(None, description="What was found in an uploaded file.")


class SceneList(BaseModel):
    """All scenes: built-in ones, those of the server's folder, uploaded ones."""

    items: list[SceneView]


class RunView(RunInfo):
    """A nightly run. accepted: later runs of its suite are compared with it; page: what changed since the accepted run."""

    accepted: bool
    page: str


class RunList(BaseModel):
    """A page of nightly runs, latest first. `next_cursor` is null on the last one."""

    items: list[RunView]
    next_cursor: str | None = None


class RowImages(BaseModel):
    """Addresses of PNGs of one frame of a changed row: both runs' images, their difference, the reference where there is one."""

    frame: int
    before: str
    after: str
    difference: str
    reference: str | None = None


class ComparisonLinks(BaseModel):
    """Where to go from a comparison."""

    page: str


class ComparisonView(Comparison):
    """What changed from run or evaluation `a` (null: nothing was accepted yet) to `b`. images: by the key of their row."""

    a: str | None
    b: str
    headline: str
    images: dict[str, list[RowImages]]
    links: ComparisonLinks


def links(status: Status, report: bool | None = None) -> Links:
    """Addresses below the service's root. A report is there once the evaluation has ended, unless told otherwise."""
    base = f"/v1/evaluations/{status.id}"
    there = status.state in ENDED if report is None else report
    return Links(
        self=base, page=f"/evaluations/{status.id}", events=f"{base}/events", results=f"{base}/results",
        report=f"{base}/report/" if there else None,
    )  # fmt: skip


def summary(status: Status) -> EvaluationSummary:
    """What lists show."""
    return EvaluationSummary(
        id=status.id, state=status.state, created=str(status.created), finished=_text(status.finished), request=status.request,
        progress=Progress(done=status.progress["done"], total=status.progress["total"]), error=status.error, links=links(status),
    )  # fmt: skip


def view(status: Status) -> EvaluationView:
    """All there is."""
    return EvaluationView(**dict(summary(status)), cells=list(status.cells))


def _text(value: object) -> str | None:
    return None if value is None else str(value)
