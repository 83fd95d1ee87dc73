"""A row over the frames of a sequence: error, flicker, time and work of each frame, and which frame is worst."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from reports.folder import Cell
from reports.results import Result
from reports.rows import Row

Read = Callable[[Result], float | None]
MOST_COUNTERS = 8


@dataclass(frozen=True)
class Series:
    """One quantity of a row over frames, mean over seeds; frames where it isn't known are left out."""

    row: Row
    frames: tuple[int, ...]
    values: tuple[float, ...]


def series(row: Row, read: Read) -> Series:
    """The values that `read` finds in the row's results."""
    by_frame: dict[int, list[float]] = defaultdict(list)
    for cell, result in row.done:
        value = read(result)
        if value is not None:
            by_frame[cell.frame].append(value)
    frames = tuple(sorted(by_frame))
    return Series(row, frames, tuple(float(np.mean(by_frame[frame])) for frame in frames))


def matched(metric: str) -> Read:
    """Reads a metric against the matched reference."""
    return lambda result: result.metrics.get("matched", {}).get(metric)


def matched_floor(metric: str) -> Read:
    """Reads what the matched references' noise alone produces of a metric."""
    return lambda result: result.noise_floor.get("matched", {}).get(metric)


def wall_seconds(result: Result) -> float | None:
    """Wall seconds of the render stage; None where nothing was timed."""
    return result.seconds if result.timings else None


def counter(name: str) -> Read:
    """Reads a work count."""
    return lambda result: result.counters.get(name)


def changing_counters(rows: Sequence[Row]) -> list[str]:
    """Counters that change from frame to frame in some row, counts of records first; at most MOST_COUNTERS."""
    names = sorted({name for row in rows for name in row.counters}, key=lambda name: ("record" not in name, name))
    found = [name for name in names if any(len(set(series(row, counter(name)).values)) > 1 for row in rows)]
    return found[:MOST_COUNTERS]


def is_sequence(row: Row) -> bool:
    """Whether the row has results of more than one frame."""
    return len(row.frames) > 1


def compared(row: Row) -> list[int]:
    """Frames of the row that were compared with a matched reference."""
    return list(series(row, matched("rmse")).frames)


def worst(row: Row) -> tuple[Cell, float] | None:
    """The cell with the greatest RMSE against its matched reference, the first of equals, and that RMSE; None without any."""
    errors = [(error, cell) for cell, result in row.done if (error := matched("rmse")(result)) is not None]
    if not errors:
        return None
    error, cell = max(errors, key=lambda pair: pair[0])
    return cell, error


def total_seconds(row: Row) -> float | None:
    """Wall seconds of all frames, mean over seeds; None where a frame wasn't timed."""
    times = series(row, wall_seconds)
    return float(sum(times.values)) if list(times.frames) == row.frames else None


def first_seconds(row: Row) -> float | None:
    """Wall seconds of the first frame, mean over seeds."""
    times = series(row, wall_seconds)
    return times.values[0] if times.frames and times.frames[0] == row.frames[0] else None
