"""Measure one published claim."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jobs.claims import Answer, Bench, get_claim
from jobs.tasks import ClaimTask


def reproduce(task: ClaimTask, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """The claim's Answer as plain data. progress gets `doing`, one line on what is being rendered."""
    bench = Bench(lambda line: progress({"doing": line}))
    found = get_claim(task.claim).measure(bench)
    return Answer.of(task.claim, found, bench.device).model_dump(mode="json")
