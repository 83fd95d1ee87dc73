"""What each node of a plan does: a function of plan, node, the outcomes it builds on and the artefact store.

Nothing is kept in memory. Images and results are made in a folder that is thrown away, and committed to the store; the outcome
says under which hashes.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jobs.artifacts import Artifacts
from jobs.comparing import Comparison, ReferenceImage, against
from jobs.errors import Failure, StoreError, TaskError, describe
from jobs.files import write_model
from jobs.folder import write_folder
from jobs.graph import Node, exposure_reference, references_of
from jobs.leftovers import work_folder
from jobs.machine import use_of
from jobs.outcome import Order, Outcome, Outcomes
from jobs.plan import Plan, reference_id
from jobs.points import reach
from jobs.process import Limits, run_task
from jobs.store import Store
from jobs.tasks import PilotTask, ReferenceTask, RenderTask
from renderers.images import read_exr
from reports.results import NOT_DETERMINISTIC, Result

Task = RenderTask | PilotTask | ReferenceTask
Progress = Callable[[dict[str, Any]], None]
Runner = Callable[[Task, Limits, Progress], dict[str, Any]]
Asked = Callable[[], None]

TRIES = 3
STORED = ("images", "references", "logs")  # folders whose files other nodes have stored
BACK_OFF_S = (0.5, 2.0)


@dataclass(frozen=True)
class Bench:
    """Where work is done. asked: raises TaskError where the work was cancelled or lost, called often. runner: carries tasks out.

    wall_s, memory_bytes: limits of a child where the order has none.
    """

    artifacts: Artifacts
    store: Store = field(default_factory=Store)
    runner: Runner = run_task
    progress: Progress = lambda detail: None
    asked: Asked = lambda: None
    wall_s: float | None = None
    memory_bytes: int | None = None


def carry_out(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench) -> Outcome:
    """Do one node's work. Every failure is an outcome; nothing is raised but what ends the process."""
    do: dict[str, Callable[..., Outcome]] = {
        "reference": _reference, "pilot": _pilot, "render": _render, "aliasing": _aliasing, "compare": _compare, "report": _report,
    }  # fmt: skip
    try:
        with machine(node, bench), work_folder() as folder:
            bench.asked()
            return do[node.kind](plan, order, node, before, bench, folder)
    except TaskError as error:
        failure = error
    except StoreError as error:
        failure = TaskError(str(error), failure="store")
    except OSError as error:
        failure = TaskError(describe(error), traceback.format_exc(), "store")
    except Exception as error:  # the node's edge: a fault in our own code is this node's failure and no other's
        failure = TaskError(describe(error), traceback.format_exc())
    return Outcome.of(failure, _keep_log(failure, bench))


def machine(node: Node, bench: Bench) -> AbstractContextManager[None]:
    """Hold the machine as the node needs it: timed work alone, all other work beside untimed work."""
    return use_of(bench.store.home / "machine", alone=node.queue == "gl", stop=bench.asked)


def all_well(before: Outcomes) -> None:
    """Raises TaskError naming the first of the nodes that this one builds on and that did not end well."""
    for name, outcome in before.items():
        if outcome.state != "done":
            raise TaskError(f"{name}: {outcome.error}", failure=_passed_on(outcome))


def _reference(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench, folder: Path) -> Outcome:
    cache = bench.store.references
    task = plan.references[node.key].model_copy(
        update={"folder": folder, "cache": cache, "max_seconds": order.max_seconds, "store": bench.artifacts.url}
    )
    answer = _child(task, order, bench)
    exposure = None
    if node.key == exposure_reference(plan, task.scene_name) and task.scene_name not in plan.exposures:
        key = f"exposure {answer['scene_hash']}"
        exposure = bench.artifacts.bind(key, "first", {"exposure": answer["exposure"]}).value["exposure"]
        bench.store.keep_exposure(answer["scene_hash"], exposure)
    return Outcome(files=_commit(bench, folder, [task.image]), data={"info": answer["info"], "exposure": exposure})


def _pilot(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench, folder: Path) -> Outcome:
    task = plan.pilots[node.key]
    answer = _child(task.model_copy(update={"folder": folder}), order, bench)
    return Outcome(files=_commit(bench, folder, [task.output]), data={"settings": answer["settings"]})


def _render(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench, folder: Path) -> Outcome:
    all_well(before)
    task = plan.renders[node.key]
    changes: dict[str, Any] = {"folder": folder, "repeats": order.repeats, "run": order.run}
    for pilot in before.values():
        changes |= {"settings": pilot.data["settings"], "settings_file": None}
    task = task.model_copy(update=changes | {"store": bench.artifacts.url if order.reuse else None})
    answer = _child(task, order, bench)
    reach("render before commit")
    results = {output: Result.model_validate_json((folder / output.result).read_text()) for output in task.outputs}
    files = _commit(bench, folder, [output.image for output in task.outputs])
    files |= _commit(bench, folder, [output.result for output in task.outputs])
    reach("render after commit")
    rows = list(results.values())
    frames = {str(output.frame): [files[output.image], files[output.result]] for output in task.outputs}
    identity = " ".join(result.frame_hash for result in rows)
    bound = bench.artifacts.bind(answer["key"], identity, {"frames": frames, "run": order.run})
    seconds: dict[str, float] = {}
    for timing in (timing for result in rows if not answer["cached"] for timing in result.timings):
        seconds[timing["stage"]] = seconds.get(timing["stage"], 0.0) + timing["wall_s"]
    clash = bound.clash or bench.artifacts.clashed(answer["key"])
    return Outcome(files=files, data={"clash": clash}, seconds=seconds)


def _aliasing(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench, folder: Path) -> Outcome:
    all_well(before)
    first = plan.request.frames[0]
    pair = [_reference_image(reference_id(node.key, "full", pixel, first), before, bench, folder) for pixel in ("centre", "box")]
    found = against(pair[1].mean, pair[0], exposure_of(plan, node.key, before))
    return Outcome(data={"aliasing": found})


def _compare(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench, folder: Path) -> Outcome:
    rendered = before[f"render:{node.key}"]
    if rendered.state != "done":
        return rendered.model_copy(update={"log": None, "files": {}, "failure": _passed_on(rendered)})
    all_well(before)
    task = plan.renders[node.key]
    exposure = exposure_of(plan, task.scene_name, before)
    references = references_of(plan, node.key)
    files: dict[str, str] = {}
    comparison = Comparison(exposure)
    for output in task.outputs:
        bench.asked()
        bench.artifacts.get_file(rendered.files[output.image], folder / output.image)
        test = read_exr(folder / output.image)[0]["beauty"]
        keys = references.get(output.frame, {})
        own = {role: _reference_image(key, before, bench, folder) for role, key in keys.items()}
        metrics, floors = comparison.frame(output.frame, test, own)
        result = Result.model_validate_json(bench.artifacts.get(rendered.files[output.result]))
        notes = [*result.notes, CLASH] if rendered.data["clash"] else result.notes
        changes = {"metrics": metrics, "noise_floor": floors, "notes": notes}
        write_model(folder / output.result, result.model_copy(update=changes))
        files |= _commit(bench, folder, [output.result])
        (folder / output.image).unlink()
    return Outcome(files=files)


def _report(plan: Plan, order: Order, node: Node, before: Outcomes, bench: Bench, folder: Path) -> Outcome:
    import reports

    write_folder(plan, order, before, bench.artifacts, folder)
    reach("report before write")
    reports.write(folder)
    reach("report before commit")
    paths = [str(path.relative_to(folder)) for path in sorted(folder.rglob("*")) if path.is_file()]
    return Outcome(files=_commit(bench, folder, [path for path in paths if path.split("/")[0] not in STORED]))


CLASH = f"{NOT_DETERMINISTIC}: renders of the same scene, settings, seed, device and code gave different pixels or counts"


def exposure_of(plan: Plan, scene: str, outcomes: Outcomes) -> float:
    """The scene's exposure: its own, else what its full reference at frame 0 gave. Raises TaskError where there is none yet."""
    if scene in plan.exposures:
        return plan.exposures[scene]
    outcome = outcomes.get(f"reference:{exposure_reference(plan, scene)}")
    if outcome is None or outcome.data.get("exposure") is None:
        raise TaskError(f"the exposure of {scene} is not known")
    return float(outcome.data["exposure"])


class _Asked:
    """A flag that is set once the work is to stop; keeps the reason."""

    def __init__(self, asked: Asked) -> None:
        self._asked = asked
        self.reason: TaskError | None = None

    def is_set(self) -> bool:
        """Ask, and remember the answer."""
        try:
            self._asked()
        except TaskError as error:
            self.reason = error
        return self.reason is not None


def _child(task: Task, order: Order, bench: Bench) -> dict[str, Any]:
    """Carry a task out; a child that crashed is started again, up to TRIES times."""
    flag = _Asked(bench.asked)
    limits = Limits(order.wall_s or bench.wall_s, order.memory_bytes or bench.memory_bytes, flag)
    for pause in (*BACK_OFF_S[: TRIES - 1], None):
        try:
            reach("child before start")
            answer = bench.runner(task, limits, bench.progress)
            reach("child after end")
            return answer
        except TaskError as error:
            if flag.reason is not None:
                raise TaskError(str(flag.reason), error.log, flag.reason.failure) from error
            if error.failure != "crash" or pause is None:
                raise
        _sleep(pause, flag)
    raise AssertionError("the last try returns or raises")


def _sleep(seconds: float, flag: _Asked) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if flag.is_set() and flag.reason is not None:
            raise flag.reason
        time.sleep(0.05)


def _commit(bench: Bench, folder: Path, paths: list[str]) -> dict[str, str]:
    return {path: bench.artifacts.put_file(folder / path) for path in paths}


def _reference_image(key: str, before: Outcomes, bench: Bench, folder: Path) -> ReferenceImage:
    """A reference that this node comes after, fetched once."""
    (name, artifact) = next(iter(before[f"reference:{key}"].files.items()))
    if not (folder / name).is_file():
        bench.artifacts.get_file(artifact, folder / name)
    return ReferenceImage.read(folder / name)


def _passed_on(outcome: Outcome) -> Failure:
    """The failure of a node that builds on one that did not end well."""
    return "cancelled" if outcome.state == "cancelled" else "needs"


def _keep_log(failure: TaskError, bench: Bench) -> str | None:
    """Store what the child wrote; where the store refuses that too, the failure's own line is all there is."""
    if not failure.log:
        return None
    try:
        return bench.artifacts.put(failure.log.encode())
    except StoreError:
        return None
