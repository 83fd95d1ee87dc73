"""Two evaluations side by side."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from reports.results import Result
from service.http.models import ComparedRow, Comparison

AGAINST = ("matched", "full")
Key = tuple[str, str]
Values = dict[tuple[str, str], list[float]]


def compare(a: str, b: str, first: Sequence[Result], second: Sequence[Result]) -> Comparison:
    """Means over seeds and frames of every metric and of the render seconds, for each scene and configuration that both have."""
    left, right = _gather(first), _gather(second)
    rows = []
    for key in left.keys() & right.keys():
        for against, metric in sorted(left[key].keys() | right[key].keys()):
            x, y = _mean(left[key].get((against, metric))), _mean(right[key].get((against, metric)))
            change = None if x is None or y is None else y - x
            rows.append(ComparedRow(scene=key[0], label=key[1], against=against, metric=metric, a=x, b=y, change=change))
    rows.sort(key=lambda row: (row.scene, row.label))
    only = [
        sorted(f"{scene}: {label}" for scene, label in one.keys() - other.keys()) for one, other in ((left, right), (right, left))
    ]
    return Comparison(a=a, b=b, rows=rows, only_a=only[0], only_b=only[1])


def _gather(results: Sequence[Result]) -> dict[Key, Values]:
    found: dict[Key, Values] = defaultdict(lambda: defaultdict(list))
    for result in results:
        values = found[result.scene, result.label]
        for against in AGAINST:
            for metric, value in result.metrics.get(against, {}).items():
                if value is not None:
                    values[against, metric].append(value)
        if result.timings:
            values["time", "seconds"].append(result.seconds)
    return found


def _mean(values: list[float] | None) -> float | None:
    return sum(values) / len(values) if values else None
