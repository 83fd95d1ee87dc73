"""What client and engine agree on: names, limits, the version, and how values lie in the database."""

from __future__ import annotations

from typing import Any

from dbos import Serializer

from jobs.database import is_sqlite, with_driver
from jobs.values import from_text, to_text

NAME = "luxmeter"
VERSION = "1"  # raised when the order of the workflows' steps changes; work of another version waits for a worker of that version
ORCHESTRA = "orchestra"
LIMITS = {"gl": 1, "reference": 1, "light": 2, ORCHESTRA: 64}  # workflows of a queue that one worker runs at once


class Json(Serializer):
    """How values lie in the database; see `jobs.values`."""

    def serialize(self, data: Any) -> str:
        """A value as text."""
        return to_text(data)

    def deserialize(self, serialized_data: str) -> Any:
        """The value of a text."""
        return from_text(serialized_data)

    def name(self) -> str:
        """Stands beside each value in the database."""
        return "luxmeter_json"


def workflow_id(id: str, attempt: int, node: str | None = None) -> str:
    """Id of the workflow of an attempt, or of one of its nodes."""
    return f"{id}.{attempt}" if node is None else f"{id}.{attempt}/{node}"


def address(url: str) -> str:
    """The database's URL as DBOS takes it."""
    return url if is_sqlite(url) else with_driver(url)
