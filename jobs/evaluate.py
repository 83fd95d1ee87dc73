"""Carry out a plan in a folder: child processes for references and renders, then comparisons, then the report."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jobs.comparing import Metrics, ReferenceImage, against, noise_floor
from jobs.engine import Engine, Failures, LocalEngine, Node
from jobs.errors import TaskError, describe
from jobs.files import safe_name, write_model, write_text
from jobs.graph import exposure_reference, graph, references_of
from jobs.plan import Plan, reference_id
from jobs.process import Limits, run_task
from jobs.store import Store
from jobs.tasks import PilotTask, ReferenceTask, RenderTask
from renderers.images import read_exr
from reports.folder import Cell, Evaluation, ReferenceInfo, State
from reports.results import Result

Runner = Callable[[RenderTask | PilotTask | ReferenceTask, Limits, Callable[[dict[str, Any]], None]], dict[str, Any]]


@dataclass(frozen=True)
class Event:
    """Something happened to a node: it started, told its progress (`detail`), or ended, with an error or without."""

    node: Node
    state: State
    detail: dict[str, Any] = field(default_factory=dict)
    error: str | None = None


@dataclass(frozen=True)
class Options:
    """How to carry a plan out. wall_s, memory_bytes: of each child; repeats: renders of a frame; max_seconds: of a reference."""

    command: str = ""
    repeats: int = 1
    wall_s: float | None = None
    memory_bytes: int | None = None
    max_seconds: float | None = None
    engine: Engine = field(default_factory=LocalEngine)
    store: Store = field(default_factory=Store)
    runner: Runner = run_task


def evaluate(plan: Plan, folder: Path, options: Options | None = None, notify: Callable[[Event], None] | None = None) -> Evaluation:
    """Do all of the plan's work and write the report into `folder`. A failing cell holds its error and leaves the others alone.

    Images and results stay where even the report fails: `index.html` is missing then, and `logs/` says why.

    An interrupt (Ctrl-C) ends the children, marks what was not done as cancelled, and the report is written all the same.
    """
    run = _Run(plan, folder, options or Options(), notify or (lambda event: None))
    try:
        run.options.engine.run(graph(plan), run.work, run.cancel.set)
    except KeyboardInterrupt:
        run.write_report()
    return run.evaluation


class _Run:
    """State of one evaluation under way. Its methods are called from the engine's threads; `lock` guards `evaluation`."""

    def __init__(self, plan: Plan, folder: Path, options: Options, notify: Callable[[Event], None]) -> None:
        self.plan, self.folder, self.options, self.notify = plan, folder, options, notify
        self.lock = threading.Lock()
        self.cancel = threading.Event()
        self.exposures = dict(plan.exposures)
        self.evaluation = Evaluation(
            id=plan.id, created=datetime.now(UTC).isoformat(timespec="seconds"), command=options.command,
            request=plan.request.model_dump(mode="json"), scenes=[scene.model_copy() for scene in plan.scenes],
            cells=[cell.model_copy() for cell in plan.cells],
        )  # fmt: skip
        self._save()

    def work(self, node: Node, failures: Failures) -> None:
        """Carry out one node; raises TaskError where it fails."""
        do = {
            "reference": self._reference, "pilot": self._pilot, "render": self._render,
            "aliasing": self._aliasing, "compare": self._compare, "report": self._report,
        }[node.kind]  # fmt: skip
        self.notify(Event(node, "running"))
        try:
            do(node, failures)
        except Exception as error:
            failure = error if isinstance(error, TaskError) else TaskError(describe(error), traceback.format_exc())
            self._fail(node, failure)
            raise failure from error
        self.notify(Event(node, "done"))

    def _fail(self, node: Node, failure: TaskError) -> None:
        state: State = "cancelled" if self.cancel.is_set() else "failed"
        if failure.log:
            write_text(self.folder / "logs" / f"{node.kind}.{safe_name(node.key)}.txt", failure.log)
        if node.kind in ("render", "compare"):
            self._mark(node.key, state, str(failure))
        self.notify(Event(node, state, error=str(failure)))

    def _reference(self, node: Node, failures: Failures) -> None:
        task = self.plan.references[node.key].model_copy(
            update={"folder": self.folder, "cache": self.options.store.references, "max_seconds": self.options.max_seconds}
        )
        answer = self._child(node, task)
        with self.lock:
            self.evaluation.references.append(ReferenceInfo.model_validate(answer["info"]))
            self.evaluation.references.sort(key=lambda info: info.id)
            if node.key == exposure_reference(self.plan, task.scene_name) and task.scene_name not in self.exposures:
                kept = self.options.store.keep_exposure(answer["scene_hash"], answer["exposure"])
                self.exposures[task.scene_name] = kept
            self._save()

    def _pilot(self, node: Node, failures: Failures) -> None:
        self._child(node, self.plan.pilots[node.key].model_copy(update={"folder": self.folder}))

    def _render(self, node: Node, failures: Failures) -> None:
        _all_well(failures)
        self._mark(node.key, "running")
        changes = {"folder": self.folder, "repeats": self.options.repeats}
        self._child(node, self.plan.renders[node.key].model_copy(update=changes))

    def _aliasing(self, node: Node, failures: Failures) -> None:
        _all_well(failures)
        first = self.plan.request.frames[0]
        centre, box = (self._read(reference_id(node.key, "full", pixel, first)) for pixel in ("centre", "box"))
        found = against(box.mean, centre, self.exposures[node.key])
        with self.lock:
            info = next(scene for scene in self.evaluation.scenes if scene.name == node.key)
            info.aliasing, info.exposure = found, self.exposures[node.key]
            self._save()

    def _compare(self, node: Node, failures: Failures) -> None:
        if f"render:{node.key}" in failures:
            return  # the cells hold the error already
        _all_well(failures)
        self._compare_frames(node.key)
        self._mark(node.key, "done")

    def _compare_frames(self, render: str) -> None:
        task = self.plan.renders[render]
        exposure = self.exposures[task.scene_name]
        references = references_of(self.plan, render)
        for output in task.outputs:
            test = read_exr(self.folder / output.image)[0]["beauty"]
            metrics: dict[str, Metrics] = {}
            floors: dict[str, Metrics] = {}
            for role, key in references[output.frame].items():
                reference = self._read(key)
                metrics[role], floors[role] = against(test, reference, exposure), noise_floor(reference, exposure)
            path = self.folder / output.result
            result = Result.model_validate_json(path.read_text())
            write_model(path, result.model_copy(update={"metrics": metrics, "noise_floor": floors}))

    def _report(self, node: Node, failures: Failures) -> None:
        self.write_report()

    def write_report(self) -> None:
        """Write evaluation.json and the report; cells that were not done are cancelled."""
        import reports

        with self.lock:
            for cell in self.evaluation.cells:
                if cell.state in ("queued", "running"):
                    cell.state, cell.error = "cancelled", "cancelled"
            for scene in self.evaluation.scenes:
                scene.exposure = self.exposures.get(scene.name, scene.exposure)
            self._save()
        reports.write(self.folder)

    def _read(self, key: str) -> ReferenceImage:
        return ReferenceImage.read(self.folder / self.plan.references[key].image)

    def _child(self, node: Node, task: RenderTask | PilotTask | ReferenceTask) -> dict[str, Any]:
        limits = Limits(self.options.wall_s, self.options.memory_bytes, self.cancel)
        return self.options.runner(task, limits, lambda detail: self.notify(Event(node, "running", detail)))

    def _mark(self, render: str, state: State, error: str | None = None) -> None:
        with self.lock:
            for cell in self._cells(render):
                cell.state, cell.error = state, error
            self._save()

    def _cells(self, render: str) -> list[Cell]:
        ids = {f"{render}.f{output.frame:04d}" for output in self.plan.renders[render].outputs}
        return [cell for cell in self.evaluation.cells if cell.id in ids]

    def _save(self) -> None:
        write_model(self.folder / "evaluation.json", self.evaluation)


def _all_well(failures: Failures) -> None:
    """Raises TaskError naming the first of the nodes that this one builds on and that failed."""
    for name, error in failures.items():
        raise TaskError(f"{name}: {error}")
