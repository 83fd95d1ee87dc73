"""What is needed of the one internal call into DBOS: work that an executor has taken gets back into its queue, once."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pytest
import sqlalchemy as sa
from dbos._dbos import _get_dbos_instance

from jobs.artifacts import Artifacts
from jobs.durable import engine as module
from jobs.durable.client import Client
from jobs.durable.engine import Engine
from jobs.durable.recovery import look, requeue, taken
from jobs.durable.wire import ORCHESTRA, workflow_id
from jobs.records import Records
from jobs.strays import Stray
from jobs.work import Bench

ID = workflow_id("e", 1)


def no_night(scheduled: datetime) -> None:
    raise AssertionError("there is no schedule")


@pytest.fixture
def client(database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    """A client beside an engine that takes no work of the queues that the client fills."""
    monkeypatch.setattr(module, "LIMITS", {"elsewhere": 1})
    records, client = Records(database), Client(database)
    client.register(0.05)
    engine = Engine(database, "us", records, Bench(Artifacts(str(tmp_path))), nightly=no_night, cron=None)
    engine.start()
    yield client
    engine.stop()
    client.close()
    records.close()


def take(workflow: str, executor: str) -> None:
    """Have an executor that isn't there take a workflow, as the library's dispatcher does."""
    system = _get_dbos_instance()._sys_db
    table = system.tables.workflow_status
    change = {"status": "PENDING", "executor_id": executor, "started_at_epoch_ms": 1}
    with system.engine.begin() as connection:
        connection.execute(sa.update(table).where(table.c.workflow_uuid == workflow).values(**change))


def test_work_of_an_executor_gets_back_into_its_queue_once(client: Client) -> None:
    client.enqueue("e", 1, 5)
    assert (look([ID])[ID].status, taken()) == ("ENQUEUED", [])
    take(ID, "gone")
    assert taken() == taken(["gone"]) == [Stray(ID, "gone", 1)]
    assert taken(["other"]) == []
    assert not requeue(Stray(ID, "other", 1))  # somebody took it since: it is theirs
    assert look([ID])[ID].status == "PENDING"
    assert requeue(Stray(ID, "gone", 1))
    row = look([ID])[ID]
    assert (row.status, row.queue_name, row.priority) == ("ENQUEUED", ORCHESTRA, 6)
    assert not requeue(Stray(ID, "gone", 1))
    assert taken() == []


def test_work_that_has_ended_stays_ended(client: Client) -> None:
    client.enqueue("e", 1, 5)
    take(ID, "gone")
    system = _get_dbos_instance()._sys_db
    table = system.tables.workflow_status
    with system.engine.begin() as connection:
        connection.execute(sa.update(table).values(status="SUCCESS"))
    assert not requeue(Stray(ID, "gone", 1))
    assert look([ID])[ID].status == "SUCCESS"
