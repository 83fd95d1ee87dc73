"""Render a task's frames with its method and measure them."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import statistics
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from jobs.artifacts import Artifacts
from jobs.code import code_hash, versions
from jobs.errors import TaskError
from jobs.files import whole, write_model, write_text
from jobs.points import reach
from jobs.scenes import open_scene
from jobs.settings import dump, settings_hash, validate
from jobs.tasks import FrameOutput, PilotTask, RenderTask
from renderers import Frame, Method, Scene, Timing, get_method
from renderers.images import write_exr
from renderers.method import device_string
from reports.results import Result
from reports.stored import CAPTION

WARM_UP_SIZE = (32, 18)


def render(task: RenderTask, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Write every frame's image and result; answers their number, the render's key, and whether the store had it."""
    scene = open_scene(task.scene).scene
    method = get_method(task.method)
    approximations = method.check(scene)
    settings = method.resolve(scene, validate(method, _settings(task)), device_string())
    key = render_key(task, scene, dump(settings))
    if task.store is not None and fetch(task, key):
        return {"frames": len(task.outputs), "key": key, "cached": True}
    small = (min(task.size[0], WARM_UP_SIZE[0]), min(task.size[1], WARM_UP_SIZE[1]))
    method.render(replace(scene), settings, size=small, seed=task.seed, frame=task.outputs[0].frame)
    started, measured = _now(), _measured(method, scene, settings, task)
    for done, (output, frame) in enumerate(zip(task.outputs, measured, strict=True)):
        result = _result(task, output, scene, frame, dump(settings))
        result = result.model_copy(update={"approximations": list(approximations), "started": started, "finished": _now()})
        attributes = {"scene": task.scene_name, "method": task.label, "seed": str(task.seed), "frame": str(output.frame)}
        attributes |= {f"{CAPTION}{name}": text for name, text in frame.captions.items()}
        with whole(task.folder / output.image) as path:
            write_exr(path, frame.layers, "beauty", **attributes)
        write_model(task.folder / output.result, result)
        reach("render between frames")
        progress({"done": done + 1, "of": len(task.outputs)})
        started = _now()
    return {"frames": len(task.outputs), "key": key, "cached": False}


def render_key(task: RenderTask, scene: Scene, settings: dict[str, Any]) -> str:
    """What decides the pixels: scene, frames, size, method, resolved settings, seed, GL device and code."""
    parts = {
        "scene": scene.hash, "frames": [task.outputs[0].frame, task.outputs[-1].frame], "size": task.size, "method": task.method,
        "settings": settings, "seed": task.seed, "device": device_string(), "code": code_hash(),
    }  # fmt: skip
    return f"render {json.dumps(parts, sort_keys=True)}"


def fetch(task: RenderTask, key: str) -> bool:
    """Write the frames that the store holds under this key, named as this task names them; whether it holds them all."""
    artifacts = Artifacts(task.store or "")
    found = artifacts.lookup(key)
    if found is None or not all(artifacts.has(name) for pair in found.value["frames"].values() for name in pair):
        return False
    for output in task.outputs:
        image, row = found.value["frames"][str(output.frame)]
        result = Result.model_validate_json(artifacts.get(row))
        result = result.model_copy(update={"scene": task.scene_name, "label": task.label})
        artifacts.get_file(image, task.folder / output.image)
        write_model(task.folder / output.result, result)
    return True


def run_pilot(task: PilotTask) -> dict[str, Any]:
    """Write the settings that the method's pilot chose; answers them."""
    scene = open_scene(task.scene).scene
    method: Any = get_method(task.method)
    settings = dump(method.plan(scene, validate(method, task.settings), task.size))
    write_text(task.folder / task.output, json.dumps(settings))
    return {"settings": settings}


def content_hash(frame: Frame) -> str:
    """SHA-256 over a frame's float layers and counters: equal hashes, equal images."""
    digest = hashlib.sha256()
    for name, layer in sorted(frame.layers.items()):
        digest.update(f"{name}{layer.shape}".encode())
        digest.update(np.ascontiguousarray(layer).tobytes())
    digest.update(json.dumps(dict(sorted(frame.counters.items()))).encode())
    return digest.hexdigest()


def median_timings(runs: list[tuple[Timing, ...]]) -> list[dict[str, Any]]:
    """Per pass the median of the runs' seconds; passes in the order of the first run."""
    return [_median([run[k] for run in runs]) for k in range(len(runs[0]))]


def _median(timings: list[Timing]) -> dict[str, Any]:
    gpu = [t.gpu_s for t in timings if t.gpu_s is not None]
    return asdict(timings[0]) | {
        "wall_s": statistics.median(t.wall_s for t in timings),
        "cpu_s": statistics.median(t.cpu_s for t in timings),
        "gpu_s": statistics.median(gpu) if len(gpu) == len(timings) else None,
    }


def _settings(task: RenderTask) -> dict[str, Any]:
    if task.settings_file is None:
        return task.settings
    chosen: dict[str, Any] = json.loads((task.folder / task.settings_file).read_text())
    return chosen


def _measured(method: Method, scene: Scene, settings: Any, task: RenderTask) -> Iterator[Frame]:
    """The task's frames with median timings. Every run has its own Scene object, so that nothing cached hides its preparation."""
    span = (task.outputs[0].frame, task.outputs[-1].frame)
    runs = [
        method.render_frames(replace(scene), settings, size=task.size, seed=task.seed, frames=span) for _ in range(task.repeats)
    ]
    for frames in zip(*runs, strict=True):
        if any(content_hash(frame) != content_hash(frames[0]) for frame in frames[1:]):
            raise TaskError(f"{task.method} gave two different images for one seed")
        timings = median_timings([frame.timings for frame in frames])
        yield replace(frames[0], timings=tuple(Timing(**t) for t in timings))


def _result(task: RenderTask, output: FrameOutput, scene: Scene, frame: Frame, settings: dict[str, Any]) -> Result:
    return Result(
        scene=task.scene_name, scene_hash=scene.hash, method=task.method, label=task.label, settings=settings,
        settings_hash=settings_hash(settings), seed=task.seed, frame=output.frame, width=task.size[0], height=task.size[1],
        transport=get_method(task.method).transport(validate(get_method(task.method), settings)),
        timings=[asdict(t) for t in frame.timings], counters=dict(frame.counters), notes=[*scene.notes, *frame.notes],
        frame_hash=content_hash(frame), peak_rss_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        device=device() | dict(frame.device), versions=versions(), run=task.run,
    )  # fmt: skip


def device() -> dict[str, str]:
    """What this process renders on: GL device, CPU, threads it may use, Mitsuba variant where Mitsuba is loaded."""
    found = {"gl": device_string(), "cpu": cpu_name(), "threads": str(len(os.sched_getaffinity(0)))}
    mitsuba = sys.modules.get("mitsuba")
    return found | ({"mitsuba": str(mitsuba.variant())} if mitsuba is not None else {})


def cpu_name() -> str:
    """Model name of the processor as Linux tells it."""
    with open("/proc/cpuinfo") as lines:
        return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
