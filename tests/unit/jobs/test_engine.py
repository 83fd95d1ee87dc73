"""The local engine: order, limits, timed nodes alone, failures."""

from __future__ import annotations

import threading
import time

import pytest

from jobs.engine import Failures, LocalEngine, Node
from jobs.errors import TaskError

NODES = [
    Node("r1", "reference", "r1", "reference"),
    Node("r2", "reference", "r2", "reference"),
    Node("g1", "render", "g1", "gl"),
    Node("g2", "render", "g2", "gl"),
    Node("c1", "compare", "c1", "light", ("r1", "g1")),
    Node("c2", "compare", "c2", "light", ("r2", "g2")),
    Node("c3", "compare", "c3", "light", ("r1", "g2")),
    Node("end", "report", "end", "light", ("c1", "c2", "c3")),
]


class Recorder:
    """Work that records who ran beside whom."""

    def __init__(self, failing: str = "") -> None:
        self.lock, self.running, self.ended, self.failing = threading.Lock(), set[str](), list[str](), failing
        self.together: list[frozenset[str]] = []
        self.before: dict[str, dict[str, str]] = {}

    def __call__(self, node: Node, failures: Failures) -> None:
        with self.lock:
            assert set(node.after) <= set(self.ended)
            self.running.add(node.id)
            self.together.append(frozenset(self.running))
            self.before[node.id] = dict(failures)
        time.sleep(0.01)
        with self.lock:
            self.running.remove(node.id)
            self.ended.append(node.id)
        if node.id == self.failing:
            raise TaskError("broken")


def test_every_node_runs_once_after_those_it_waits_for_and_timed_nodes_run_alone() -> None:
    work = Recorder()
    assert LocalEngine().run(NODES, work, lambda: None) == {}
    assert sorted(work.ended) == sorted(node.id for node in NODES)
    assert all(len(group) == 1 for group in work.together if group & {"g1", "g2"})
    assert not any({"r1", "r2"} <= group for group in work.together)


def test_light_nodes_share_the_machine_up_to_their_limit() -> None:
    nodes = [Node(f"c{k}", "compare", "", "light") for k in range(6)]
    work = Recorder()
    LocalEngine({"reference": 1, "gl": 1, "light": 3}).run(nodes, work, lambda: None)
    assert max(map(len, work.together)) <= 3


def test_a_failure_is_told_to_those_that_wait_and_to_nobody_else() -> None:
    work = Recorder("g2")
    assert LocalEngine().run(NODES, work, lambda: None) == {"g2": "broken"}
    assert work.before["c1"] == {}
    assert work.before["c2"] == work.before["c3"] == {"g2": "broken"}
    assert "end" in work.ended


def test_other_exceptions_end_the_run_and_stop_the_work() -> None:
    stopped = threading.Event()

    def work(node: Node, failures: Failures) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        LocalEngine().run(NODES, work, stopped.set)
    assert stopped.is_set()


def test_a_graph_that_waits_for_a_stranger_is_refused() -> None:
    with pytest.raises(ValueError, match="c waits for a node"):
        LocalEngine().run([Node("c", "compare", "", "light", ("x",))], Recorder(), lambda: None)
