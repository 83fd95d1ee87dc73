"""What can go wrong before and during the work."""

from __future__ import annotations

from typing import Literal

from pydantic import ValidationError


class RequestError(ValueError):
    """A request that can't be carried out: one line naming the field and what is allowed. Raised before any work."""


Failure = Literal["error", "crash", "timeout", "memory", "cancelled", "abandoned", "store", "needs", "poison"]
"""How work ended badly: an exception of the task; its process died; it ran over a limit; it was cancelled; the worker lost it to
another one; the store refused it; something it builds on failed; its worker died each time it was tried."""


class TaskError(RuntimeError):
    """A task that failed in its child process; the message is one line, `log` what the child wrote on its standard error."""

    def __init__(self, message: str, log: str = "", failure: Failure = "error") -> None:
        super().__init__(message)
        self.log = log
        self.failure: Failure = failure


class StoreError(RuntimeError):
    """The artefact store or the queue's database can't be read or written: full, read-only, unreachable. One line."""


def one_line(error: ValidationError) -> str:
    """The first problem of a pydantic error as `field: message (got value)`, and how many more there are."""
    first, *rest = error.errors(include_url=False)
    where = ".".join(str(part) for part in first["loc"])
    got = "" if first["type"] == "missing" else f" (got {first['input']!r})"
    more = f"; {len(rest)} more" if rest else ""
    return f"{where}: {first['msg'][0].lower()}{first['msg'][1:]}{got}{more}"


def describe(error: Exception) -> str:
    """One line: type and first line of the message."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
