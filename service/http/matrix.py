"""The cells of an evaluation as a table of scenes by method configurations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from reports.folder import Cell


@dataclass(frozen=True)
class Square:
    """All seeds and frames of one configuration in one scene: how many are in each state, and in words."""

    counts: dict[str, int]
    total: int
    state: str
    text: str


@dataclass(frozen=True)
class Matrix:
    """Rows are scenes, columns labels; None where a scene has no such configuration."""

    labels: list[str]
    rows: list[tuple[str, list[Square | None]]]


def matrix(cells: Sequence[Cell]) -> Matrix:
    """The table in the order of the cells."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    for cell in cells:
        counts.setdefault((cell.scene, cell.label), Counter())[cell.state] += 1
    scenes = list(dict.fromkeys(scene for scene, _ in counts))
    labels = list(dict.fromkeys(label for _, label in counts))
    rows = [(scene, [_square(counts[scene, label]) if (scene, label) in counts else None for label in labels]) for scene in scenes]
    return Matrix(labels, rows)


def _square(counts: Counter[str]) -> Square:
    """A square's state: failed once anything failed, running while anything runs, else that of its least finished cell."""
    total = counts.total()
    for state in ("failed", "running", "cancelled", "queued", "done"):
        if counts[state]:
            break
    waits = state == "queued" and counts["done"] > 0
    text = state if total == 1 else f"{counts['failed']} of {total} failed" if state == "failed" else f"{counts['done']} of {total}"
    return Square(dict(counts), total, "running" if waits else state, text)
