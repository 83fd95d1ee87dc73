"""Labelled points of the work, where a test can end, stop or break the process. Without a test's hook they do nothing."""

from __future__ import annotations

from collections.abc import Callable

hook: Callable[[str], None] | None = None


def reach(label: str) -> None:
    """Say that the work has come to this point."""
    if hook is not None:
        hook(label)
