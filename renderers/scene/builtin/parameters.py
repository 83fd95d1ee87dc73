"""Checked parameters of scene builders: unknown names, wrong types and values out of range are refused in one line."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable

from renderers.scene.model import Scene, SceneError

Limit = tuple[float, float] | tuple[str, ...]
Builder = Callable[..., Scene]


def checked(**limits: Limit) -> Callable[[Builder], Builder]:
    """Decorate a builder whose parameters all have defaults: numbers take (low, high) inclusive, words take the allowed ones.

    The type of a default is the type of its parameter; text such as "200000", "0.5" or "true" is converted to it. Raises
    SceneError.
    """

    def decorate(builder: Builder) -> Builder:
        defaults = {name: p.default for name, p in inspect.signature(builder).parameters.items()}

        @functools.wraps(builder)
        def build(**given: object) -> Scene:
            label = builder.__name__.replace("_", "-")
            for name in given:
                if name not in defaults:
                    raise SceneError(f"{label}: unknown parameter {name!r}; there is {', '.join(defaults) or 'none'}")
            return builder(**{n: _value(f"{label}: {n}", given.get(n, d), d, limits.get(n)) for n, d in defaults.items()})

        return build

    return decorate


def _value(label: str, value: object, default: object, limit: Limit | None) -> object:
    converted = _converted(label, value, default)
    if limit is None or isinstance(converted, bool):
        return converted
    if isinstance(converted, str):
        if converted not in limit:
            raise SceneError(f"{label} must be one of {', '.join(str(word) for word in limit)}; got {converted!r}")
    elif isinstance(converted, int | float) and not float(limit[0]) <= converted <= float(limit[1]):
        raise SceneError(f"{label} must lie in {limit[0]} .. {limit[1]}; got {converted!r}")
    return converted


def _converted(label: str, value: object, default: object) -> object:
    kind = type(default)
    refused = SceneError(f"{label} must be {kind.__name__}; got {value!r}")
    if kind is bool:
        words: dict[object, bool] = {True: True, False: False, "true": True, "false": False}
        if isinstance(value, bool | str) and value in words:
            return words[value]
        raise refused
    if kind is str:
        if isinstance(value, str):
            return value
        raise refused
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise refused
    try:
        number = float(value)
    except ValueError:
        raise refused from None
    if not math.isfinite(number) or (kind is int and number != int(number)):
        raise refused
    return int(number) if kind is int else number
