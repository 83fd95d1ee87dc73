"""Methods whose settings may name a time instead of an amount of work (`pt` with `seconds`): a pilot turns one into the other."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from renderers import Method, Scene


@runtime_checkable
class Pilot(Protocol):
    """A method with a pilot: `plan` measures and returns settings that state the amount of work."""

    def plan(self, scene: Scene, settings: Any, size: tuple[int, int]) -> Any:
        """Settings without a wanted time."""


def wants_pilot(method: Method, settings: Any) -> bool:
    """Whether these settings name a time that a pilot must turn into work."""
    return isinstance(method, Pilot) and getattr(settings, "seconds", None) is not None
