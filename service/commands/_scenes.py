"""`luxmeter scenes`: what can be rendered without a path."""

from __future__ import annotations

from service.describe import scene_documents
from service.options import Json
from service.output import print_json, print_table


def scenes(json: Json = False) -> None:
    """List the built-in scenes, their parameters, and the scenes under LUXMETER_SCENES."""
    found = scene_documents()
    if json:
        print_json(found)
    else:
        rows = [(str(s["name"]), _written(s["parameters"]), str(s["description"])) for s in found]
        print_table(("scene", "parameters", ""), rows)


def _written(values: object) -> str:
    return ",".join(f"{k}={v}" for k, v in values.items()) if isinstance(values, dict) else ""
