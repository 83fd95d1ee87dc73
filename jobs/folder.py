"""The evaluation folder that reports read, put together from a plan and the outcomes of its nodes."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from jobs.artifacts import Artifacts
from jobs.files import safe_name, write_model
from jobs.graph import exposure_reference, graph
from jobs.outcome import Order, Outcome, Outcomes
from jobs.plan import Plan
from reports.folder import Cell, Evaluation, ReferenceInfo, SceneInfo, State
from reports.results import Result


def write_folder(plan: Plan, order: Order, outcomes: Outcomes, artifacts: Artifacts, folder: Path) -> Evaluation:
    """Write every file that the outcomes name, logs and evaluation.json; returns what evaluation.json holds."""
    for path, name in files_of(plan, outcomes).items():
        artifacts.get_file(name, folder / path)
    found = evaluation(plan, order, outcomes)
    mark_cached_timings(folder, found, order.run)
    write_model(folder / "evaluation.json", found)
    return found


def files_of(plan: Plan, outcomes: Outcomes) -> dict[str, str]:
    """Path in the folder → artefact. Later nodes replace files of earlier ones: a compared result that of the render."""
    found: dict[str, str] = {}
    for node in graph(plan):
        outcome = outcomes.get(node.id)
        if outcome is None:
            continue
        found |= outcome.files
        if outcome.log is not None:
            found[f"logs/{node.kind}.{safe_name(node.key)}.txt"] = outcome.log
    return found


def evaluation(plan: Plan, order: Order, outcomes: Outcomes) -> Evaluation:
    """What is known of an evaluation once its work has ended; cells without outcomes count as cancelled."""
    cells = cells_of(plan, {name: outcome.state for name, outcome in outcomes.items()}, errors_of(outcomes))
    for cell in cells:
        if cell.state in ("queued", "running"):
            cell.state, cell.error = "cancelled", "cancelled"
    references = [o.data["info"] for name, o in outcomes.items() if name.startswith("reference:") and o.state == "done"]
    return Evaluation(
        id=order.evaluation, created=order.created, command=order.command, request=plan.request.model_dump(mode="json"),
        scenes=[_scene(plan, info, outcomes) for info in plan.scenes], cells=cells,
        references=sorted((ReferenceInfo.model_validate(info) for info in references), key=lambda info: info.id),
    )  # fmt: skip


def errors_of(outcomes: Outcomes) -> dict[str, str]:
    """The error of each node that has one."""
    return {name: outcome.error for name, outcome in outcomes.items() if outcome.error is not None}


def cells_of(plan: Plan, states: dict[str, State], errors: dict[str, str]) -> list[Cell]:
    """The plan's cells with the states that those of its nodes mean (node id → state, node id → error)."""
    found = [cell.model_copy() for cell in plan.cells]
    by_id = {cell.id: cell for cell in found}
    for key, task in plan.renders.items():
        state, error = _state_of(key, states, errors)
        for output in task.outputs:
            cell = by_id[f"{key}.f{output.frame:04d}"]
            cell.state, cell.error = state, error
    return found


def _state_of(key: str, states: dict[str, State], errors: dict[str, str]) -> tuple[State, str | None]:
    """State and error of one render's cells: done when compared, failed as soon as either node is."""
    for node in (f"render:{key}", f"compare:{key}"):
        state = states.get(node, "queued")
        if state in ("failed", "cancelled"):
            return state, errors.get(node, state)
    if states.get(f"compare:{key}") == "done":
        return "done", None
    return ("running" if states.get(f"render:{key}") in ("running", "done") else "queued"), None


def _scene(plan: Plan, info: SceneInfo, outcomes: Outcomes) -> SceneInfo:
    reference = outcomes.get(f"reference:{exposure_reference(plan, info.name)}", Outcome())
    aliasing = outcomes.get(f"aliasing:{info.name}", Outcome())
    exposure = plan.exposures.get(info.name) or reference.data.get("exposure") or info.exposure
    return info.model_copy(update={"exposure": exposure, "aliasing": aliasing.data.get("aliasing", {})})


def mark_cached_timings(folder: Path, found: Evaluation, run: str) -> None:
    """Say in each result that was not rendered in this run where its timings come from, and keep runs apart in each scene.

    Timings of different runs are not comparable. Where a scene's results come from several runs, those of this run stay, or where
    there are none those of the latest one, and the others are left out.
    """
    rows: dict[str, list[tuple[Path, Result]]] = defaultdict(list)
    for cell in found.cells:
        path = folder / "results" / f"{cell.id}.json"
        if path.is_file():
            rows[cell.scene].append((path, Result.model_validate_json(path.read_text())))
    for own in rows.values():
        latest = max(own, key=lambda pair: (pair[1].run == run, pair[1].started))[1].run
        for path, result in own:
            if result.run != run:
                write_model(path, _from_cache(result, keep=result.run == latest))


def _from_cache(result: Result, *, keep: bool) -> Result:
    note = f"image and counts are from the cache, rendered {result.started}"
    if keep:
        return result.model_copy(update={"notes": [*result.notes, f"{note} and timed then, in one run with all of this scene"]})
    note += "; its timings are left out: times of different runs are never compared"
    return result.model_copy(update={"notes": [*result.notes, note], "timings": []})
