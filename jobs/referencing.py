"""Path-trace a task's reference and write it down."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jobs.artifacts import Artifacts
from jobs.files import whole
from jobs.scenes import open_scene
from jobs.tasks import ReferenceTask
from renderers import Scene
from renderers.images import write_exr
from renderers.reference import Reference
from renderers.reference import store as references
from reports.folder import ReferenceInfo
from reports.results import NOT_DETERMINISTIC

SPP: Literal[64, 256] = 64  # samples a pixel of one replicate, the renderer's default


class Shared:
    """One reference in the artefact store: what any machine has reached is where every machine goes on."""

    def __init__(self, task: ReferenceTask, scene: Scene) -> None:
        frame = task.frame if scene.channels else 0
        self.parts = references.identity(scene.hash, frame, task.size, task.transport, task.pixel, SPP, None)
        self.key = references.key_of(self.parts)
        self.folder = task.cache or Path()
        self.artifacts = Artifacts(task.store or "")

    def pull(self) -> None:
        """Fetch the stored sums where they hold more replicates than those of this machine."""
        found = self.artifacts.lookup(f"reference {self.key}")
        here = references.load(self.folder, self.parts)
        if found is not None and found.value["n"] > (0 if here is None else here.n) and self.artifacts.has(found.value["sums"]):
            self.artifacts.get_file(found.value["sums"], self.folder / f"{self.key}.npz")

    def push(self, reference: Reference, digest: str) -> bool:
        """Store the sums where they hold more replicates than the stored ones; whether equal replicates gave other sums before."""
        found = self.artifacts.lookup(f"reference {self.key}")
        if found is None or found.value["n"] < reference.n or not self.artifacts.has(found.value["sums"]):
            sums = self.artifacts.put_file(self.folder / f"{self.key}.npz")
            self.artifacts.point(f"reference {self.key}", {"n": reference.n, "sums": sums})
        return self.artifacts.bind(f"reference {self.key} of {reference.n}", digest, {}).clash


def reference(task: ReferenceTask, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Write the reference's image; answers `info` (a ReferenceInfo), the scene's hash and the exposure this image suggests."""
    from renderers import reference as renderer
    from renderers.transport.revealed import revealed

    def report(replicates: int, noise: float, eta: float | None) -> None:
        progress({"replicates": replicates, "noise": noise, "eta": eta})

    start = time.perf_counter()
    scene = open_scene(task.scene).scene
    shared = Shared(task, scene) if task.store is not None and task.cache is not None else None
    if shared is not None:
        shared.pull()
    ref = renderer.render(
        scene, task.transport, size=task.size, noise=task.noise, pixel=task.pixel, frame=task.frame,
        store=task.cache, max_seconds=task.max_seconds, progress=report, spp=SPP,
    )  # fmt: skip
    digest = hashlib.sha256(ref.total.tobytes() + ref.squares.tobytes() + f"{ref.n},{ref.spp}".encode()).hexdigest()
    layers = {"mean": ref.image, "variance": ref.variance, "luminance_variance": ref.luminance_variance}
    if ref.noise_sample is not None:
        layers["noise_sample"] = ref.noise_sample
    hidden_before = revealed(scene, task.frame, task.size, task.begin) if task.pixel == "centre" else None
    if hidden_before is not None:
        layers["revealed"] = hidden_before.astype(np.float32)
    with whole(task.folder / task.image) as path:
        write_exr(path, layers, "mean", n=str(ref.n), spp=str(ref.spp), transport=task.transport, pixel=task.pixel)
    info = ReferenceInfo(
        id=task.id, scene=task.scene_name, frame=task.frame, transport=task.transport, pixel=task.pixel, noise=ref.noise,
        asked=task.noise, replicates=ref.n, spp=ref.spp, seconds=time.perf_counter() - start, content_hash=digest,
        notes=list(ref.notes),
    )  # fmt: skip
    if shared is not None and shared.push(ref, digest):
        info.notes.append(f"{NOT_DETERMINISTIC}: these {ref.n} replicates differ from those that were stored first")
    return {"info": info.model_dump(mode="json"), "scene_hash": scene.hash, "exposure": renderer.exposure(ref)}
