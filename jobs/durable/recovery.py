"""Whose work is what, as DBOS's tables say, and how it gets back into its queue.

The open-source library has no public call that returns the work of a dead executor to its queues. `requeue` uses the one with which
the library itself recovers after a restart; `tests/unit/jobs/test_durable_contract.py` holds it to what is needed of it here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dbos import DBOS
from dbos._dbos import _get_dbos_instance
from dbos._utils import INTERNAL_QUEUE_NAME

from jobs.durable.wire import VERSION
from jobs.strays import Stray


def look(workflows: Sequence[str]) -> dict[str, Any]:
    """What the database says of workflows, by their id."""
    rows = DBOS.list_workflows(workflow_ids=list(workflows), load_input=False, load_output=False)
    return {row.workflow_id: row for row in rows}


def taken(executors: Sequence[str] | None = None) -> list[Stray]:
    """Workflows of our version that executors have taken and not ended; those of the named executors, or of all."""
    named = None if executors is None else list(executors)
    rows = DBOS.list_workflows(status="PENDING", app_version=VERSION, executor_id=named, load_input=False, load_output=False)
    return [Stray(row.workflow_id, row.executor_id or "", row.dequeued_at) for row in rows]


def requeue(work: Stray) -> bool:
    """Put a workflow back into its queue, unless another executor has taken it since; whether it was put back."""
    return _get_dbos_instance()._sys_db.reenqueue_for_recovery(work.workflow, [work.executor], INTERNAL_QUEUE_NAME)
