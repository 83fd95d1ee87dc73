"""Submissions that wait together share one transaction: all of them are kept, or none."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from databases import new_file

from jobs.errors import StoreError
from jobs.graph import Node
from jobs.intake import Intake, Submission
from jobs.outcome import Order
from jobs.records import Records

NODES = [(Node("report", "report", "", "light", ()), None)]


def submission(name: str) -> Submission:
    return Submission(Order(evaluation=name, plan="0" * 64, run="r", created="now"), "{}", 5, NODES, time.time())


@pytest.fixture
def path(sqlite_template: Path, tmp_path: Path) -> Path:
    new_file(sqlite_template, tmp_path / "queue.sqlite")
    return tmp_path / "queue.sqlite"


@pytest.fixture
def records(path: Path) -> Iterator[Records]:
    found = Records(f"sqlite:///{path}", wait_s=5)
    yield found
    found.close()


def test_those_that_wait_share_one_commit(records: Records) -> None:
    begun, go, enqueued, commits = threading.Event(), threading.Event(), [], []

    def enqueue(connection: sa.Connection, s: Submission) -> None:
        enqueued.append(s.order.evaluation)
        begun.set()
        go.wait(120)

    intake = Intake(records, enqueue)
    sa.event.listen(records._engine, "commit", lambda connection: commits.append(1))
    with ThreadPoolExecutor(8) as pool:
        first = pool.submit(intake.add, submission("a"))
        begun.wait(120)
        others = [pool.submit(intake.add, submission(name)) for name in "dcbbda"]
        while len(intake._waiting) < 6:
            time.sleep(0.001)
        go.set()
        assert first.result()
        assert sum(other.result() for other in others) == 3
    assert enqueued == ["a", "b", "c", "d"]
    assert len(commits) == 2
    assert {row["id"] for row in records.page(None, 10, None)} == set("abcd")


def test_what_fails_fails_for_all_that_shared_it_and_leaves_nothing(records: Records) -> None:
    broken = [True]

    def enqueue(connection: sa.Connection, s: Submission) -> None:
        if broken[0]:
            raise StoreError("the disk is full")

    intake = Intake(records, enqueue)
    with pytest.raises(StoreError, match="disk is full"):
        intake.add(submission("a"))
    assert records.page(None, 10, None) == []
    broken[0] = False
    assert intake.add(submission("a"))
    assert not intake.add(submission("a"))


def test_a_write_lock_of_another_process_is_waited_out_or_told(path: Path, records: Records) -> None:
    def nothing(connection: sa.Connection, s: Any) -> None:
        pass

    other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    other.execute("begin immediate")
    released = threading.Event()

    def release() -> None:
        released.set()
        other.execute("commit")

    threading.Timer(0.3, release).start()
    assert Intake(records, nothing).add(submission("a"))
    assert released.is_set()
    other.execute("begin immediate")
    hasty = Records(records.url, wait_s=0.05)
    try:
        with pytest.raises(StoreError, match="locked"):
            Intake(hasty, nothing).add(submission("b"))
        other.execute("commit")
        assert Intake(hasty, nothing).add(submission("b"))
    finally:
        hasty.close()
        other.close()
