"""A stopped worker's process: its tasks are ended, it is woken, and whose it is is known from its place."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from jobs.machine import holder, only_one
from jobs.place import lock_of, place
from jobs.stopped import children, end_tasks, is_stopped, keepers, wake

# A process with two children that sleep: one carries out a task, the other doesn't.
PARENT = """
import subprocess, sys
sleep = "import time; time.sleep(600)"
subprocess.Popen([sys.executable, "-c", sleep, "jobs.child"], process_group=0)
subprocess.Popen([sys.executable, "-c", sleep, "something else"], process_group=0)
print("ready", flush=True)
sys.stdin.read()
"""

WRITER = """
import sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("begin immediate")
database.execute("insert into t values (1)")
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def parent() -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([sys.executable, "-c", PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    yield process
    for child in children(process.pid):
        os.kill(child, signal.SIGKILL)
    process.kill()
    process.communicate()


def soon(condition: object) -> bool:
    deadline = time.monotonic() + 20
    while not condition() and time.monotonic() < deadline:  # type: ignore[operator]
        time.sleep(0.02)
    return bool(condition())  # type: ignore[operator]


def state(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]


def test_only_tasks_are_ended(parent: subprocess.Popen[str]) -> None:
    both = children(parent.pid)
    assert len(both) == 2
    assert soon(lambda: sum(b"-c" in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in both) == 2)
    os.kill(parent.pid, signal.SIGSTOP)
    assert end_tasks(parent.pid) == 1
    assert soon(lambda: sorted(state(pid) == "Z" for pid in both) == [False, True])


def test_a_stopped_process_is_woken_and_a_running_one_left_alone(parent: subprocess.Popen[str]) -> None:
    assert not wake(parent.pid)
    os.kill(parent.pid, signal.SIGSTOP)
    assert soon(lambda: is_stopped(parent.pid))
    assert wake(parent.pid)
    assert soon(lambda: not is_stopped(parent.pid))


def test_who_keeps_others_from_a_database(tmp_path: Path) -> None:
    """Only who writes does: a reader and an open connection keep nobody away. Asking costs us no lock of our own."""
    path = tmp_path / "a.sqlite"
    assert keepers(path) == []
    with contextlib.closing(sqlite3.connect(path)) as ours:
        ours.execute("pragma journal_mode=wal")
        ours.execute("create table t (a)")
        ours.execute("select * from t").fetchall()
        assert keepers(path) == []
        with subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            assert keepers(path) == [process.pid]
            assert keepers(tmp_path / "b.sqlite") == []
            process.communicate()
        assert keepers(path) == []
        ours.execute("insert into t values (2)")
        assert keepers(path) == [os.getpid()]


def test_who_holds_a_lock(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    assert holder(path) is None
    with only_one(path) as ours:
        assert ours
        assert holder(path) == os.getpid()
    assert holder(path) is None


def test_a_worker_is_found_by_its_name_in_its_own_folder_only(tmp_path: Path) -> None:
    with place(tmp_path / "a") as first, place(tmp_path / "a") as second, place(tmp_path / "b") as stranger:
        assert len({first, second, stranger}) == 3
        lock = lock_of(second, tmp_path / "a")
        assert lock is not None
        assert holder(lock) == os.getpid()
        assert lock_of(stranger, tmp_path / "a") is None
    with place(tmp_path / "a") as again:
        assert again == first
