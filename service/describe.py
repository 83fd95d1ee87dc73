"""Methods and scenes as plain documents: what `luxmeter methods --json`, `luxmeter scenes --json` and the HTTP interface show."""

from __future__ import annotations

from typing import Any

from jobs.scenes import parameters, scene_folders
from jobs.settings import schema
from renderers import Method, builtin_scenes
from renderers.scene.model import NEEDS


def default_transport(method: Method) -> str:
    """Light paths of an image with the method's default settings."""
    return method.transport(method.Settings())


def method_document(method: Method) -> dict[str, Any]:
    """Name, title, source, default transport, JSON schema of the settings, and the claim about every need."""
    claims = {need: {"support": method.claim(need).support, "how": method.claim(need).how} for need in NEEDS}
    return {
        "name": method.name, "title": method.title, "source": method.source, "transport": default_transport(method),
        "settings": schema(method), "claims": claims,
    }  # fmt: skip


def scene_documents() -> list[dict[str, Any]]:
    """Built-in scenes with their parameters, then those of the folder that LUXMETER_SCENES names."""
    found: list[dict[str, Any]] = [
        {"name": name, "kind": "built-in", "description": text, "parameters": {k: str(v) for k, v in parameters(name).items()}}
        for name, text in builtin_scenes().items()
    ]
    return found + [{"name": name, "kind": "folder", "description": "", "parameters": {}} for name in scene_folders()]
