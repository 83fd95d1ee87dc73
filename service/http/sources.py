"""What can be compared: nightly runs of the data folder, and evaluations that have ended."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from reports.runs import Baseline, BrokenBaseline, RunInfo, history, pointer, runs_folder
from service.http.problems import Problem
from service.http.queue import ENDED, Queue

RETRY_S = "5"
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Source:
    """One side of a comparison. folder: a run's, None for an evaluation; identity: changes when its content does."""

    id: str
    kind: Literal["run", "evaluation"]
    identity: str
    folder: Path | None = None


class Sources:
    """Finds runs and evaluations by id."""

    def __init__(self, home: Path, queue: Queue) -> None:
        self.home, self.queue = home, queue

    def runs(self) -> list[RunInfo]:
        """Nightly runs, latest first."""
        return history(self.home)

    def accepted(self, suite: str) -> Baseline | None:
        """The accepted run of a suite, by its pointer alone: whether its files are whole is checked when it is compared. A pointer
        that can't be read counts as none.
        """
        try:
            return pointer(self.home, suite)
        except BrokenBaseline as error:
            log.warning("%s", error)
            return None

    def find(self, id: str) -> Source:
        """A run or an ended evaluation. Raises Problem where there is none, or where the evaluation still runs."""
        for run in self.runs():
            if run.id == id:
                return Source(id, "run", run.digest, runs_folder(self.home) / id)
            baseline = self.accepted(run.suite)
            if baseline is not None and baseline.id == id:
                return _of(baseline)
        try:
            status = self.queue.status(id)
        except KeyError:
            raise Problem("not-found", f"no nightly run and no evaluation {id}") from None
        if status.state not in ENDED:
            raise Problem("not-ready", f"{id} is {status.state}", {"retry-after": RETRY_S})
        return Source(id, "evaluation", f"{id} {status.finished}")

    def latest(self) -> Source:
        """The latest run. Raises Problem before the first night."""
        runs = self.runs()
        if not runs:
            raise Problem("not-found", "there is no nightly run yet; name two evaluations as a and b")
        return self.find(runs[0].id)

    def before(self, after: Source) -> Source | None:
        """What a run is compared with unless asked otherwise: the accepted run of its suite; for that run itself the one it was
        compared with. None where nothing was accepted. Raises Problem for an evaluation.
        """
        run = next((run for run in self.runs() if run.id == after.id), None)
        if after.kind == "evaluation" or run is None:
            raise Problem("validation-failed", f"query parameter a: name what {after.id} is to be compared with")
        baseline = self.accepted(run.suite)
        if baseline is None:
            return None
        if baseline.id != run.id:
            return _of(baseline)
        known = {run.id for run in self.runs()}
        return self.find(run.baseline) if run.baseline in known else None


def _of(baseline: Baseline) -> Source:
    return Source(baseline.id, "run", baseline.digest, Path(baseline.folder))
