"""`luxmeter scenes`: what can be rendered without a path."""

from __future__ import annotations

from jobs.scenes import parameters, scene_folders
from renderers import builtin_scenes
from service.options import Json
from service.output import print_json, print_table


def scenes(json: Json = False) -> None:
    """List the built-in scenes, their parameters, and the scenes under LUXMETER_SCENES."""
    found = [
        {"name": name, "kind": "built-in", "description": text, "parameters": {k: str(v) for k, v in parameters(name).items()}}
        for name, text in builtin_scenes().items()
    ]
    found += [{"name": name, "kind": "folder", "description": "", "parameters": {}} for name in scene_folders()]
    if json:
        print_json(found)
    else:
        rows = [(str(s["name"]), _written(s["parameters"]), str(s["description"])) for s in found]
        print_table(("scene", "parameters", ""), rows)


def _written(values: object) -> str:
    return ",".join(f"{k}={v}" for k, v in values.items()) if isinstance(values, dict) else ""
