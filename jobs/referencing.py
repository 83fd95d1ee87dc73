"""Path-trace a task's reference and write it down."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from typing import Any

from jobs.files import whole
from jobs.scenes import open_scene
from jobs.tasks import ReferenceTask
from renderers.images import write_exr
from reports.folder import ReferenceInfo


def reference(task: ReferenceTask, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Write the reference's image; answers `info` (a ReferenceInfo), the scene's hash and the exposure this image suggests."""
    from renderers import reference as renderer

    def report(replicates: int, noise: float, eta: float | None) -> None:
        progress({"replicates": replicates, "noise": noise, "eta": eta})

    start = time.perf_counter()
    scene = open_scene(task.scene).scene
    ref = renderer.render(
        scene, task.transport, size=task.size, noise=task.noise, pixel=task.pixel, frame=task.frame,
        store=task.cache, max_seconds=task.max_seconds, progress=report,
    )  # fmt: skip
    digest = hashlib.sha256(ref.total.tobytes() + ref.squares.tobytes() + f"{ref.n},{ref.spp}".encode()).hexdigest()
    layers = {"mean": ref.image, "variance": ref.variance, "luminance_variance": ref.luminance_variance}
    with whole(task.folder / task.image) as path:
        write_exr(path, layers, "mean", n=str(ref.n), spp=str(ref.spp), transport=task.transport, pixel=task.pixel)
    info = ReferenceInfo(
        id=task.id, scene=task.scene_name, frame=task.frame, transport=task.transport, pixel=task.pixel, noise=ref.noise,
        asked=task.noise, replicates=ref.n, spp=ref.spp, seconds=time.perf_counter() - start, content_hash=digest,
        notes=list(ref.notes),
    )  # fmt: skip
    return {"info": info.model_dump(mode="json"), "scene_hash": scene.hash, "exposure": renderer.exposure(ref)}
