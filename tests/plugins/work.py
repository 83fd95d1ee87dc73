"""A function's work, counted: a bound on a count holds on a busy machine and late in a long run; one on seconds does not."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

# A few hundredths of a second. The first image that a process opens takes 29,000, to import its reader.
FEW_CALLS = 50_000


@dataclass
class Work:
    """Calls of functions, Python's and C's, that the `with` block made in its own thread."""

    calls: int = 0


@contextmanager
def counted() -> Iterator[Work]:
    """Count the calls made inside. What numpy does inside one call is not seen: bound the memory too."""
    work = Work()

    def see(frame: FrameType, event: str, argument: object) -> None:
        work.calls += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(see)
    try:
        yield work
    finally:
        sys.setprofile(before)
