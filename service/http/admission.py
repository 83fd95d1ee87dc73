"""What a request over HTTP may ask for, checked before anything is planned: scenes by name only, a bounded number of cells."""

from __future__ import annotations

import math

from jobs.request import EvaluationRequest
from jobs.scenes import scene_folders
from renderers import builtin_scenes
from service.http.problems import Problem
from service.http.site import Site


def admit(request: EvaluationRequest, site: Site) -> None:
    """Raises Problem where the request names a path or an unknown scene, or would be too large to plan."""
    known = {*scene_folders()}
    built_in = builtin_scenes()
    for name in request.scenes:
        if name.partition(":")[0] not in built_in and name not in known and site.uploads.find(name) is None:
            raise Problem(
                "unknown-scene",
                f"no scene {name[:100]!r}; built-in scenes, those of the server's folder and uploaded ones have names",
            )
    variants = sum(math.prod(len(values) for values in method.sweep.values()) for method in request.methods)
    frames = request.frames[1] - request.frames[0] + 1
    cells = len(request.scenes) * variants * request.seeds * frames
    if cells > site.settings.max_cells:
        raise Problem("invalid-request", f"{cells} cells are more than one evaluation takes ({site.settings.max_cells})")
