"""What a process that does no work asks of the engine."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from dbos import DBOS, DBOSClient

from jobs.database import prepare_file, readable_errors
from jobs.durable.wire import LIMITS, NAME, ORCHESTRA, VERSION, Json, address, workflow_id


class Client:
    """A connection to the engine's tables. Raises StoreError where the database can't be used."""

    def __init__(self, url: str) -> None:
        self.url = url
        with readable_errors(url):
            prepare_file(url)
            DBOS.migrate(address(url))
            self._client = DBOSClient(system_database_url=address(url), serializer=Json(), application_name=NAME)

    def enqueue(self, id: str, attempt: int, priority: int, within: sa.Connection | None = None) -> None:
        """Have an attempt of an evaluation worked on; asking twice is asking once. within: a transaction to be part of."""
        options: Any = {
            "workflow_name": "evaluate", "queue_name": ORCHESTRA, "workflow_id": workflow_id(id, attempt), "app_version": VERSION,
            "priority": priority + 1,
        }  # fmt: skip
        with readable_errors(self.url):
            if within is None:
                self._client.enqueue(options, id, attempt)
            else:
                self._client.enqueue_in_transaction(within, options, id, attempt)

    def register(self, poll_s: float) -> None:
        """Make the queues known: an engine that finds them when it starts begins to take work at once, and else a second later."""
        with readable_errors(self.url):
            for name, limit in LIMITS.items():
                self._client.register_queue(name, worker_concurrency=limit, polling_interval_sec=poll_s)

    def forget(self, id: str) -> None:
        """Delete all workflows of an evaluation."""
        with readable_errors(self.url):
            known = self._client.list_workflows(workflow_id_prefix=f"{id}.", load_input=False, load_output=False)
            self._client.delete_workflows([status.workflow_id for status in known])

    def check(self) -> None:
        """Raises StoreError where the database can't be reached."""
        with readable_errors(self.url):
            self._client.check_connection()

    def close(self) -> None:
        """Close all connections."""
        self._client.destroy()
