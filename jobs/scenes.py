"""Scenes as users name them: built in (`cornell-box:light=area`), a file, a folder under LUXMETER_SCENES, or an upload."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from jobs.store import Store
from renderers import Scene, SceneError, load_scene

UPLOAD = "upload-"


@dataclass(frozen=True)
class NamedScene:
    """A loaded scene, the name reports call it by and the text that loads it again."""

    name: str
    text: str
    scene: Scene


def open_scene(text: str) -> NamedScene:
    """Load a scene from what the user wrote. Raises SceneError in one line."""
    from renderers.scene.builtin import BUILTIN

    builder = BUILTIN.get(text.partition(":")[0])
    if builder is not None:
        return _built_in(text, builder)
    uploaded = upload_file(text)
    if uploaded is not None:
        return NamedScene(text, text, load_scene(uploaded))
    path = Path(text)
    name = text
    if path.suffix:
        name = path.stem if path.stem != "scene" else path.resolve().parent.name
        text = str(path.resolve())
    return NamedScene(name, text, load_scene(text))


@lru_cache(maxsize=16)
def _built_in(text: str, builder: Callable[..., Scene]) -> NamedScene:
    """A built-in scene, kept with what was computed of it: a service plans the same few again and again."""
    base, colon, tail = text.partition(":")
    return NamedScene(text, text, builder(**(_parameters(base, tail) if colon else {})))


def parameters(name: str) -> dict[str, Any]:
    """Parameters of a built-in scene with their defaults."""
    from renderers.scene.builtin import BUILTIN

    return {p.name: p.default for p in inspect.signature(BUILTIN[name]).parameters.values()}


def scene_folders() -> list[str]:
    """Names of the scenes under LUXMETER_SCENES, sorted."""
    folder = os.environ.get("LUXMETER_SCENES")
    return sorted(p.parent.name for p in Path(folder).glob("*/scene.glb")) if folder else []


def upload_file(name: str, home: Path | None = None) -> Path | None:
    """File of the scene that was uploaded under this name (`upload-` and 32 hexadecimal digits), None where there is none."""
    path = Store(home).home / "scenes" / f"{name}.glb"
    return path if re.fullmatch(f"{UPLOAD}[0-9a-f]{{32}}", name) and path.is_file() else None


def _parameters(base: str, text: str) -> dict[str, Any]:
    from renderers.scene.builtin import BUILTIN

    known = parameters(base)
    types = get_type_hints(BUILTIN[base])
    values = {}
    for part in text.split(","):
        key, equals, value = part.partition("=")
        if not equals or key not in known:
            raise SceneError(f"{base} has no parameter {key!r}; it has {', '.join(known) or 'none'} (write {base}:name=value,…)")
        try:
            values[key] = TypeAdapter(types.get(key, str)).validate_python(value)
        except ValidationError as error:
            raise SceneError(f"{base}:{key}={value}: {error.errors()[0]['msg']}") from None
    return values
