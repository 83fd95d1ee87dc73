"""A method's settings from what a user typed or posted, and what to say when they don't fit."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from jobs.errors import RequestError
from renderers import Method, Settings

LIMITS = {
    "minimum": "≥ {}",
    "exclusiveMinimum": "> {}",
    "maximum": "≤ {}",
    "exclusiveMaximum": "< {}",
    "multipleOf": "multiple of {}",
}


def validate(method: Method, values: Mapping[str, Any]) -> Settings:
    """The method's settings. Raises RequestError naming method, setting and range."""
    try:
        settings: Settings = method.Settings.model_validate(dict(values))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in first["loc"]) or "settings"
        properties = schema(method)["properties"]
        if first["type"] == "extra_forbidden":
            raise RequestError(f"{method.name} has no setting {name!r}; it has {', '.join(properties)}") from None
        field = properties.get(str(first["loc"][0]), {}) if first["loc"] else {}
        allowed = limits(field)
        wanted = f"must be {allowed}" if allowed else first["msg"]
        raise RequestError(f"{method.name}.{name} {wanted} (got {first['input']!r})") from None
    return settings


def schema(method: Method) -> dict[str, Any]:
    """JSON schema of the method's settings."""
    described: dict[str, Any] = method.Settings.model_json_schema()
    return described


def limits(field: Mapping[str, Any]) -> str:
    """Type and range of one field of a JSON schema in words: `integer ≥ 1, ≤ 64`, `point or area`."""
    if "enum" in field:
        return " or ".join(str(v) for v in field["enum"])
    if "const" in field:
        return str(field["const"])
    if "anyOf" in field:
        return " or ".join(limits(option) for option in field["anyOf"])
    kind = {"null": "none"}.get(field.get("type", ""), field.get("type", ""))
    bounds = ", ".join(text.format(field[key]) for key, text in LIMITS.items() if key in field)
    return f"{kind} {bounds}".strip()


def dump(settings: Settings) -> dict[str, Any]:
    """Settings as plain JSON values."""
    return settings.model_dump(mode="json")


def settings_hash(settings: Mapping[str, Any]) -> str:
    """SHA-256 of the settings' canonical JSON."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
