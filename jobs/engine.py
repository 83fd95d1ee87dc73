"""Carry out a graph of nodes in the order of their dependencies. LocalEngine does it in this process's threads.

Nodes of queue `gl` are timed, so one of them runs alone: beside it neither a reference nor a comparison uses the machine. The other
queues run beside one another up to their limits. Another engine with the same `run` can replace this one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Literal, Protocol

from jobs.errors import TaskError

Queue = Literal["reference", "gl", "light"]
Failures = Mapping[str, str]


@dataclass(frozen=True)
class Node:
    """One piece of work. It runs when all of `after` have ended, well or not; `kind` and `key` say what it is."""

    id: str
    kind: Literal["reference", "pilot", "render", "aliasing", "compare", "report"]
    key: str
    queue: Queue
    after: tuple[str, ...] = ()


class Engine(Protocol):
    """Runs nodes; `work(node, failures)` gets the failures of the nodes it comes after. Returns every failure by node id."""

    def run(self, nodes: Sequence[Node], work: Callable[[Node, Failures], None], stop: Callable[[], None]) -> Failures:
        """Run all nodes. A TaskError of `work` is the node's failure; any other exception ends the run.

        `stop` is called when the run ends early, by an exception or an interrupt; it makes the work under way end soon.
        """


@dataclass
class LocalEngine:
    """At most `limits[queue]` nodes of a queue at once, in the order they are listed."""

    limits: Mapping[Queue, int] = field(default_factory=lambda: {"reference": 1, "gl": 1, "light": 2})

    def run(self, nodes: Sequence[Node], work: Callable[[Node, Failures], None], stop: Callable[[], None]) -> Failures:
        """See Engine."""
        failures: dict[str, str] = {}
        with ThreadPoolExecutor(sum(self.limits.values())) as pool:
            try:
                self._run(nodes, lambda node, before: pool.submit(work, node, before), failures)
            except BaseException:
                stop()
                raise
        return failures

    def _run(self, nodes: Sequence[Node], start: Callable[[Node, Failures], Future[None]], failures: dict[str, str]) -> None:
        waiting, ended = list(nodes), set[str]()
        running: dict[Future[None], Node] = {}
        while waiting or running:
            for node in self._startable(waiting, ended, list(running.values())):
                waiting.remove(node)
                running[start(node, {id: failures[id] for id in node.after if id in failures})] = node
            if not running:
                raise ValueError(f"{waiting[0].id} waits for a node that isn't in the graph")
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                node = running.pop(future)
                ended.add(node.id)
                try:
                    future.result()
                except TaskError as error:
                    failures[node.id] = str(error)

    def _startable(self, waiting: Sequence[Node], ended: set[str], running: Sequence[Node]) -> list[Node]:
        """Nodes to start now: untimed ones first, a timed one only when the machine is idle."""
        if any(node.queue == "gl" for node in running):
            return []
        ready = [node for node in waiting if ended.issuperset(node.after)]
        chosen: list[Node] = []
        for node in ready:
            taken = sum(other.queue == node.queue for other in [*running, *chosen])
            if node.queue != "gl" and taken < self.limits[node.queue]:
                chosen.append(node)
        if chosen or running:
            return chosen
        return [node for node in ready if node.queue == "gl"][:1]
