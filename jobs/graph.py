"""The graph of a plan: references and renders → comparisons → report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from jobs.plan import Plan, reference_id

REPORT = "report"
WINDOW = 32  # nodes of one evaluation that wait in a queue or run
Queue = Literal["reference", "gl", "light"]


@dataclass(frozen=True)
class Node:
    """One piece of work. It runs when all of `after` have ended, well or not; `kind` and `key` say what it is."""

    id: str
    kind: Literal["reference", "pilot", "render", "aliasing", "compare", "report"]
    key: str
    queue: Queue
    after: tuple[str, ...] = ()


def graph(plan: Plan) -> list[Node]:
    """Nodes of the plan in a good order: a scene's references, then its renders and comparisons, at last the report."""
    nodes = [Node(f"reference:{key}", "reference", key, "reference") for key in plan.references]
    nodes += [Node(f"pilot:{key}", "pilot", key, "gl") for key in plan.pilots]
    pilots = {task.output: key for key, task in plan.pilots.items()}
    for key, task in plan.renders.items():
        after: tuple[str, ...] = () if task.settings_file is None else (f"pilot:{pilots[task.settings_file]}",)
        nodes.append(Node(f"render:{key}", "render", key, "gl", after))
    first = plan.request.frames[0]
    for scene in plan.scenes:
        pair = tuple(reference_id(scene.name, "full", pixel, first) for pixel in ("centre", "box"))
        if pair[1] in plan.references:
            after = tuple(f"reference:{key}" for key in dict.fromkeys((*pair, exposure_reference(plan, scene.name))))
            nodes.append(Node(f"aliasing:{scene.name}", "aliasing", scene.name, "light", after))
    nodes += [_compare(plan, key) for key in plan.renders]
    return [*nodes, Node(REPORT, "report", "", "light", tuple(node.id for node in nodes))]


def exposure_reference(plan: Plan, scene: str) -> str:
    """Id of the reference that gives a scene's exposure: the full one at frame 0; the first where the scene has its own."""
    return reference_id(scene, "full", "centre", plan.request.frames[0] if scene in plan.exposures else 0)


def references_of(plan: Plan, render: str) -> dict[int, dict[str, str]]:
    """For each frame of a render that has references the ids of the `matched` and the `full` one."""
    task = plan.renders[render]
    compared = frozenset(plan.request.reference_frames)
    transport = next(cell.transport for cell in plan.cells if cell.id == f"{render}.f{task.outputs[0].frame:04d}")
    return {
        output.frame: {
            "matched": reference_id(task.scene_name, transport, "centre", output.frame),
            "full": reference_id(task.scene_name, "full", "centre", output.frame),
        }
        for output in task.outputs
        if output.frame in compared
    }


def startable(waiting: Sequence[Node], done: set[str], running: Mapping[str, Node], references_first: bool) -> list[Node]:
    """Nodes to enqueue now: all light ones that can start, and others while there is room in the window."""
    ready = [node for node in waiting if done.issuperset(node.after)]
    room = WINDOW - sum(node.queue != "light" for node in running.values())
    heavy = [node for node in ready if node.queue != "light"]
    if references_first and any(node.queue == "reference" for node in (*waiting, *running.values())):
        heavy = [node for node in heavy if node.queue == "reference"]
    return [node for node in ready if node.queue == "light"] + heavy[: max(room, 0)]


def withdrawable(nodes: Sequence[Node], states: Mapping[str, str]) -> list[str]:
    """Nodes of a cancelled evaluation that needn't be done: what renders was done is still compared, and the report written."""
    lost = {node.id for node in nodes if node.queue != "light" and states[node.id] != "done"}
    lost |= {node.id for node in nodes if node.id != REPORT and not lost.isdisjoint(node.after)}
    return [node.id for node in nodes if node.id in lost and states[node.id] == "queued"]


def _compare(plan: Plan, render: str) -> Node:
    wanted = [key for pair in references_of(plan, render).values() for key in pair.values()]
    wanted.append(exposure_reference(plan, plan.renders[render].scene_name))
    after = (f"render:{render}", *(f"reference:{key}" for key in dict.fromkeys(wanted)))
    return Node(f"compare:{render}", "compare", render, "light", after)
