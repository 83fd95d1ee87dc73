"""A request becomes a plan: every cell, every reference, validated before any work is done."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from jobs.code import code_hash
from jobs.errors import RequestError
from jobs.files import safe_name
from jobs.pilot import wants_pilot
from jobs.request import EvaluationRequest, MethodRequest
from jobs.scenes import NamedScene, open_scene
from jobs.settings import dump, validate
from jobs.tasks import FrameOutput, PilotTask, ReferenceTask, RenderTask
from renderers import Method, UnsupportedScene, get_method
from renderers.method import Transport
from reports.folder import Cell, SceneInfo

LONGEST_NAME = 120
MOST_CELLS = 20_000


@dataclass(frozen=True)
class Variant:
    """One method with one set of settings. `label` names what the request set, so that rows of one method differ."""

    method: Method
    settings: dict[str, Any]
    label: str
    transport: Transport
    pilot: bool


@dataclass
class Plan:
    """What is to be done. Cells of one render share its id up to the frame; `refused` says of cells why they can't be rendered."""

    request: EvaluationRequest
    id: str
    scenes: list[SceneInfo] = field(default_factory=list)
    cells: list[Cell] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    pilots: dict[str, PilotTask] = field(default_factory=dict)
    renders: dict[str, RenderTask] = field(default_factory=dict)
    references: dict[str, ReferenceTask] = field(default_factory=dict)
    exposures: dict[str, float] = field(default_factory=dict)


def plan(request: EvaluationRequest) -> Plan:
    """Expand scenes × methods × settings × seeds × frames. Raises RequestError, SceneError or UnknownMethod in one line."""
    count = cell_count(request)
    if count > MOST_CELLS:
        raise RequestError(f"{count} cells are more than one evaluation takes ({MOST_CELLS})")
    request = normalised(request)
    variants = [variant for wanted in request.methods for variant in expand(wanted)]
    labels = [v.label for v in variants]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise RequestError(f"{twice[0]} is asked for twice")
    result = Plan(request, evaluation_id(request))
    for text in request.scenes:
        _add_scene(result, open_scene(text), variants)
    if len(result.refused) == len(result.cells):
        raise RequestError(next(iter(result.refused.values())))
    return result


def cell_count(request: EvaluationRequest) -> int:
    """How many cells a request has; asked before anything is expanded, since a body of a few kilobytes may ask for billions."""
    variants = sum(math.prod(len(values) for values in wanted.sweep.values()) for wanted in request.methods)
    return len(request.scenes) * variants * request.seeds * (request.frames[1] - request.frames[0] + 1)


def expand(wanted: MethodRequest) -> Iterator[Variant]:
    """All variants of one requested method: the product of its sweeps over its settings."""
    method = get_method(wanted.name)
    for values in itertools.product(*wanted.sweep.values()):
        chosen = wanted.settings | dict(zip(wanted.sweep, values, strict=True))
        settings = validate(method, chosen)
        full = dump(settings)
        label = " ".join([method.name, *(f"{key}={full[key]}" for key in chosen)])
        yield Variant(method, full, label, method.transport(settings), wants_pilot(method, settings))


def normalised(request: EvaluationRequest) -> EvaluationRequest:
    """The same request with every setting as its model reads it ("64" becomes 64), so that equal requests have equal ids."""
    methods = []
    for wanted in request.methods:
        method = get_method(wanted.name)
        full = dump(validate(method, wanted.settings))
        sweep = {
            key: [dump(validate(method, wanted.settings | {key: v}))[key] for v in values] for key, values in wanted.sweep.items()
        }
        methods.append(wanted.model_copy(update={"settings": {key: full[key] for key in wanted.settings}, "sweep": sweep}))
    return request.model_copy(update={"methods": methods})


def evaluation_id(request: EvaluationRequest) -> str:
    """Hash of what is asked (not of its priority) and of the code that answers."""
    body = json.dumps(request.model_dump(mode="json", exclude={"priority"}), sort_keys=True)
    return hashlib.sha256(f"{body}\n{code_hash()}".encode()).hexdigest()[:16]


def _add_scene(plan: Plan, named: NamedScene, variants: list[Variant]) -> None:
    if any(info.name == named.name for info in plan.scenes):
        raise RequestError(f"two scenes are called {named.name}")
    scene, request = named.scene, plan.request
    world = scene.world(request.frames[0])
    needs = sorted(scene.needs)
    plan.scenes.append(
        SceneInfo(
            name=named.name, hash=scene.hash, needs=needs, notes=list(scene.notes), triangles=len(world.triangles), fps=scene.fps
        )
    )
    if scene.exposure is not None:
        plan.exposures[named.name] = scene.exposure
    transports = set[Transport]()
    for variant in variants:
        refusal = _refusal(variant, named)
        for seed in range(request.seeds):
            _add_render(plan, named, variant, seed, refusal)
        if refusal is None:
            transports.add(variant.transport)
    if transports:
        _add_references(plan, named, transports | {"full"})


def _refusal(variant: Variant, named: NamedScene) -> str | None:
    try:
        variant.method.check(named.scene)
    except UnsupportedScene as error:
        return str(error)
    return None


def _add_render(plan: Plan, named: NamedScene, variant: Variant, seed: int, refusal: str | None) -> None:
    request = plan.request
    render = _unique(plan, f"{safe_name(named.name)}.{safe_name(variant.label)}.s{seed}")
    outputs = []
    for frame in range(request.frames[0], request.frames[1] + 1):
        cell = f"{render}.f{frame:04d}"
        outputs.append(FrameOutput(frame=frame, image=f"images/{cell}.exr", result=f"results/{cell}.json"))
        plan.cells.append(
            Cell(
                id=cell, scene=named.name, method=variant.method.name, label=variant.label, settings=variant.settings, seed=seed,
                frame=frame, width=request.size[0], height=request.size[1], transport=variant.transport,
                state="queued" if refusal is None else "failed", error=refusal,
            )
        )  # fmt: skip
        if refusal is not None:
            plan.refused[cell] = refusal
    if refusal is not None:
        return
    pilot = _add_pilot(plan, named, variant) if variant.pilot else None
    plan.renders[render] = RenderTask(
        scene=named.text, scene_name=named.name, method=variant.method.name, label=variant.label, settings=variant.settings,
        settings_file=pilot, seed=seed, size=request.size, outputs=tuple(outputs),
    )  # fmt: skip


def _add_pilot(plan: Plan, named: NamedScene, variant: Variant) -> str:
    name = f"{safe_name(named.name)}.{safe_name(variant.label)}"
    path = f"pilots/{name}.json"
    plan.pilots[name] = PilotTask(
        scene=named.text, method=variant.method.name, settings=variant.settings, size=plan.request.size, output=path
    )
    return path


def _add_references(plan: Plan, named: NamedScene, transports: set[Transport]) -> None:
    first = plan.request.frames[0]
    wanted = [(t, "centre", frame) for frame in plan.request.reference_frames for t in sorted(transports)]
    wanted.append(("full", "box", first))
    if first > 0 and named.name not in plan.exposures:
        wanted.append(("full", "centre", 0))
    for transport, pixel, frame in wanted:
        name = reference_id(named.name, transport, pixel, frame)
        plan.references[name] = ReferenceTask.model_validate(
            {
                "id": name, "scene": named.text, "scene_name": named.name, "transport": transport, "pixel": pixel, "frame": frame,
                "begin": first, "size": plan.request.size, "noise": plan.request.noise, "image": f"references/{name}.exr",
            }
        )  # fmt: skip


def reference_id(scene: str, transport: str, pixel: str, frame: int) -> str:
    """Readable, file-name safe id of one reference of an evaluation."""
    return f"{safe_name(scene)}.{transport}.{pixel}.f{frame:04d}"


def _unique(plan: Plan, name: str) -> str:
    """`name`, shortened and made unique among the plan's renders."""
    taken = {cell.id.rsplit(".f", 1)[0] for cell in plan.cells}
    if len(name) > LONGEST_NAME:
        name = f"{name[: LONGEST_NAME - 9]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
    return next(n for n in itertools.chain([name], (f"{name}-{k}" for k in itertools.count(2))) if n not in taken)
