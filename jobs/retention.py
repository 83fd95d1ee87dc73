"""What is kept how long: evaluations by age, artefacts as long as something names them or they are young, caches by size.

Artefacts that an evaluation names stay as long as it does. The caches, renders and references of finished work, give way when the
store is larger than allowed, what was used longest ago first. Nothing younger than a grace is removed: it may belong to work under
way whose rows aren't written yet, or to the embedded queue of a command.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from jobs.artifacts import is_hash
from jobs.queue import JobQueue

DAY_S = 86_400.0
GRACE_S = 2 * DAY_S


@dataclass(frozen=True)
class Removed:
    """What a clean-up removed: evaluations, cache entries, artefacts, and their bytes; and files that were never finished."""

    evaluations: int = 0
    entries: int = 0
    artifacts: int = 0
    size: int = 0
    unfinished: int = 0


def clean_up(
    queue: JobQueue, *, days: float = 90.0, most_bytes: int | None = None, grace_s: float = GRACE_S, now: float | None = None
) -> Removed:
    """Forget evaluations that ended more than `days` ago, and what only they named; shrink the store towards `most_bytes`."""
    moment = time.time() if now is None else now
    old = queue.records.ended_before(moment - days * DAY_S)
    for id in old:
        queue.forget(id)
    cache = {path: (_entry(queue, path), used) for path, _, used in queue.artifacts.entries("keys")}
    sizes = {PurePosixPath(path).name: (path, size, used) for path, size, used in queue.artifacts.entries("sha256")}
    needed = _named_by_evaluations(queue)
    kept = dict(sorted(cache.items(), key=lambda item: item[1][1], reverse=True))
    entries = 0
    if most_bytes is not None:
        entries = _give_way(queue, kept, sizes, needed, most_bytes, moment - grace_s)
    alive = needed | {name for entry, _ in kept.values() for name in hashes_in(entry)}
    doomed = [item for name, item in sizes.items() if name not in alive and item[2] < moment - grace_s]
    unfinished = [path for path, written in queue.artifacts.leftovers() if written < moment - grace_s]
    for path in [path for path, _, _ in doomed] + unfinished:
        queue.artifacts.remove(path)
    return Removed(len(old), entries, len(doomed), sum(size for _, size, _ in doomed), len(unfinished))


def hashes_in(value: Any) -> set[str]:
    """Every artefact hash in a JSON value."""
    if isinstance(value, str):
        return {value} if is_hash(value) else set()
    if isinstance(value, Mapping):
        value = list(value.values())
    return {name for item in value for name in hashes_in(item)} if isinstance(value, list) else set()


def _named_by_evaluations(queue: JobQueue) -> set[str]:
    """Artefacts of evaluations that are kept: plans, files, logs."""
    found = set[str]()
    for order in queue.records.all_orders():
        found.add(order.plan)
        for outcome in queue.records.outcomes(order.evaluation).values():
            found.update(outcome.files.values())
            found.update(filter(None, [outcome.log]))
    return found


def _give_way(
    queue: JobQueue, kept: dict[str, tuple[Any, float]], sizes: Mapping[str, tuple[str, int, float]], needed: set[str],
    most_bytes: int, oldest: float,
) -> int:  # fmt: skip
    """Remove cache entries, those used longest ago first, until what is still named fits; `kept` loses them too."""
    names = {path: hashes_in(entry) - needed for path, (entry, _) in kept.items()}
    users: dict[str, int] = {}
    for name in (name for own in names.values() for name in own):
        users[name] = users.get(name, 0) + 1
    total = sum(sizes[name][1] for name in needed | set(users) if name in sizes)
    removed = 0
    for path in [path for path in reversed(kept) if names[path]]:
        if total <= most_bytes or kept[path][1] > oldest:
            break
        queue.artifacts.remove(path)
        del kept[path]
        removed += 1
        for name in names[path]:
            users[name] -= 1
            total -= sizes[name][1] if users[name] == 0 and name in sizes else 0
    return removed


def _entry(queue: JobQueue, path: str) -> Any:
    """What a key's file says; a damaged one names nothing."""
    try:
        return json.loads(queue.artifacts.read(path)).get("value", {})
    except (json.JSONDecodeError, FileNotFoundError):
        return {}
