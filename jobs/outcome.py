"""What became of a piece of work, and how an evaluation is carried out: plain data that the queue keeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from jobs.errors import Failure, TaskError

Ended = Literal["done", "failed", "cancelled"]


class Order(BaseModel):
    """How to carry a plan out. `plan` is its artefact; `run` tells timings of this run from those of others.

    repeats: renders of a frame; wall_s, memory_bytes: limits of each child (None: the worker's own); max_seconds: of a reference;
    reuse: whether renders that the store holds are taken from there instead of being timed anew. references_first: renders wait
    for all references, which costs nothing where one machine does both, and leaves more compared when it is interrupted.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    evaluation: str
    plan: str
    run: str
    created: str
    command: str = ""
    repeats: int = 1
    wall_s: float | None = None
    memory_bytes: int | None = None
    max_seconds: float | None = None
    reuse: bool = True
    references_first: bool = False


class Outcome(BaseModel):
    """How one node ended. `files`: paths in the evaluation's folder → artefacts; `data`: what later nodes need of it.

    error, failure: one line and its kind where it did not end well; log: artefact of what the child wrote.
    seconds: of the renders, by stage.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    state: Ended = "done"
    error: str | None = None
    failure: Failure | None = None
    log: str | None = None
    files: dict[str, str] = {}
    data: dict[str, Any] = {}
    seconds: dict[str, float] = {}

    @classmethod
    def of(cls, error: TaskError, log: str | None = None) -> Outcome:
        """The outcome of work that failed."""
        state: Ended = "cancelled" if error.failure == "cancelled" else "failed"
        return cls(state=state, error=str(error), failure=error.failure, log=log)


Outcomes = Mapping[str, Outcome]
CANCELLED = Outcome(state="cancelled", error="cancelled", failure="cancelled")
