"""The machine's lock: timed work alone, other work together, nobody starves, a process that dies lets go."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from jobs.machine import let_go, only_one, use_of


def nothing() -> None:
    """Never stops a wait."""


def test_sharers_share_and_the_lone_one_waits_for_them(tmp_path: Path) -> None:
    got = threading.Event()

    def alone() -> None:
        with use_of(tmp_path, alone=True, stop=nothing):
            got.set()

    with use_of(tmp_path, alone=False, stop=nothing), use_of(tmp_path, alone=False, stop=nothing):
        thread = threading.Thread(target=alone)
        thread.start()
        assert not got.wait(0.3)
    assert got.wait(120)
    thread.join()


def test_who_waits_to_be_alone_is_not_overtaken(tmp_path: Path) -> None:
    order = list[str]()

    def take(name: str, alone: bool) -> None:
        with use_of(tmp_path, alone=alone, stop=nothing):
            order.append(name)

    threads = [threading.Thread(target=take, args=("alone", True)), threading.Thread(target=take, args=("later", False))]
    with use_of(tmp_path, alone=False, stop=nothing):
        for thread in threads:
            thread.start()
            time.sleep(0.2)
        assert order == []
    for thread in threads:
        thread.join()
    assert order == ["alone", "later"]


def test_a_wait_can_be_stopped(tmp_path: Path) -> None:
    def stop() -> None:
        raise InterruptedError

    with use_of(tmp_path, alone=True, stop=nothing), pytest.raises(InterruptedError), use_of(tmp_path, alone=False, stop=stop):
        raise AssertionError("two have the machine")


def test_a_stopped_holder_can_be_passed_over(tmp_path: Path) -> None:
    got = threading.Event()

    def alone() -> None:
        with use_of(tmp_path, alone=True, stop=nothing):
            got.set()

    with use_of(tmp_path, alone=True, stop=nothing):
        thread = threading.Thread(target=alone)
        thread.start()
        assert not got.wait(0.2)
        let_go(tmp_path)
        assert got.wait(120)
    thread.join()


def test_a_killed_holder_lets_go(tmp_path: Path) -> None:
    program = (
        "import sys, time; from pathlib import Path; from jobs.machine import use_of\n"
        "with use_of(Path(sys.argv[1]), alone=True, stop=lambda: None): print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE)
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"held\n"
    with only_one(tmp_path / "room.lock") as ours:
        assert not ours
    holder.kill()
    holder.wait()
    holder.stdout.close()
    with only_one(tmp_path / "room.lock") as ours:
        assert ours
