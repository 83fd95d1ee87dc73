"""How many event streams are open, so that they can't use up the service's connections."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from service.http.problems import Problem

RETRY_S = "5"


class Streams:
    """A counter with a limit; used from the event loop only."""

    def __init__(self, most: int) -> None:
        self.most, self.open = most, 0

    def check(self) -> None:
        """Raises Problem where no further stream is taken."""
        if self.open >= self.most:
            raise Problem("unavailable", f"{self.most} event streams are open already; poll instead", {"retry-after": RETRY_S})

    @contextmanager
    def one(self) -> Iterator[None]:
        """Count one stream while the block runs."""
        self.open += 1
        try:
            yield
        finally:
            self.open -= 1
