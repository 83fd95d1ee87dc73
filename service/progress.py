"""Progress bars on stderr."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from jobs.evaluate import Event
from jobs.graph import graph
from jobs.plan import Plan
from service.output import console


@contextmanager
def task_progress(title: str, quiet: bool) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A spinner for one task; the callback takes what its child tells."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), TextColumn("{task.fields[detail]}"))
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bars:
        bar = bars.add_task(title, total=None, detail="")
        yield lambda detail: bars.update(bar, detail=describe(detail))


@contextmanager
def evaluation_progress(plan: Plan, quiet: bool) -> Iterator[Callable[[Event], None]]:
    """A bar over all nodes of an evaluation, and what is running now."""
    columns = (
        SpinnerColumn(), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"),
        TextColumn("{task.fields[detail]}"),
    )  # fmt: skip
    running: dict[str, str] = {}
    lock = threading.Lock()
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bars:
        bar = bars.add_task("", total=len(graph(plan)), detail="")

        def notify(event: Event) -> None:
            with lock:
                if event.state == "running":
                    running[event.node.id] = describe(event.detail)
                else:
                    running.pop(event.node.id, None)
                    bars.advance(bar)
                now = next(reversed(running.items()), ("", ""))
                bars.update(bar, description=now[0], detail=now[1])
            if event.error and event.node.kind != "compare":
                bars.console.print(f"{event.node.id}: {event.error}", markup=False, highlight=False)

        yield notify


def describe(detail: dict[str, Any]) -> str:
    """What a child told, in words: what it is doing, frames done, or noise reached and seconds to go."""
    if "doing" in detail:
        return str(detail["doing"])
    if "noise" in detail:
        eta = detail.get("eta")
        return f"noise {detail['noise']:.4f}" + ("" if eta is None else f", {eta:.0f} s to go")
    return f"{detail['done']}/{detail['of']} frames" if "done" in detail else ""
