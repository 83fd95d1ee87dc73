"""Values as the engine keeps them in the database: JSON, since whoever can write there must not thereby run code in the workers."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any


def to_text(value: Any) -> str:
    """JSON; exceptions become their description, times ISO 8601. Raises TypeError for what isn't plain data."""
    return json.dumps(value, default=_tagged)


def from_text(text: str) -> Any:
    """The inverse of `to_text`; an exception comes back as a RuntimeError with its description."""
    return json.loads(text, object_hook=_untagged)


def _tagged(value: Any) -> dict[str, str]:
    if isinstance(value, datetime):
        return {"__time__": value.isoformat()}
    if isinstance(value, BaseException):
        return {"__error__": f"{type(value).__name__}: {value}"}
    raise TypeError(f"{type(value).__name__} is not kept in the database")


def _untagged(value: dict[str, Any]) -> Any:
    if set(value) == {"__time__"}:
        return datetime.fromisoformat(value["__time__"])
    return RuntimeError(value["__error__"]) if set(value) == {"__error__"} else value
