"""What a scene's numbers allow to say: which method is closest to the truth, and whether that is more than noise.

The order of the questions is fixed: are the images the same bytes (then nothing else is asked), does the difference exceed the
uncertainty over seeds, and can the reference's own noise decide it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from reports.comparison import TOO_NOISY, reference_too_noisy
from reports.format import number, seconds
from reports.registry import METRICS
from reports.rows import AGAINST, PATH_TRACER, Against, Row
from reports.statistics import difference, equal_time

Kind = Literal["identical", "decided", "within seeds", "one seed", "within reference", "alone"]
Decides = Callable[[Row, Row, Against], bool | None]


@dataclass(frozen=True)
class Order:
    """How the best row stands to the next one. gap: difference of their RMSE; half: half width of its 95 % interval, if there is
    one.
    """

    best: Row
    second: Row | None
    kind: Kind
    gap: float = 0.0
    half: float | None = None


def ranking(rows: Sequence[Row], against: Against) -> list[Row]:
    """Rows that were measured, best RMSE first."""
    measured = [(found.mean, k) for k, row in enumerate(rows) if (found := row.interval(against, "rmse")) is not None]
    return [rows[k] for _, k in sorted(measured)]


def same_bytes(a: Row, b: Row) -> bool:
    """Whether two rows hold the same images, seed by seed and frame by frame, by hash."""
    hashes = [{(c.seed, c.frame): r.frame_hash for c, r in row.done} for row in (a, b)]
    return bool(hashes[0]) and hashes[0] == hashes[1] and all(hashes[0].values())


def order(rows: Sequence[Row], against: Against, decides: Decides) -> Order | None:
    """The best row and how surely it is the best; None when no row was measured. `decides` asks the reference about two rows."""
    ranked = ranking(rows, against)
    if not ranked:
        return None
    if len(ranked) == 1:
        return Order(ranked[0], None, "alone")
    best, second = ranked[:2]
    if same_bytes(best, second):
        return Order(best, second, "identical")
    found = difference(second.values(against, "rmse"), best.values(against, "rmse"))
    half = None if found.high is None or found.low is None else (found.high - found.low) / 2
    if half is not None and not found.decided:
        return Order(best, second, "within seeds", found.value, half)
    if decides(best, second, against) is False:
        return Order(best, second, "within reference", found.value, half)
    return Order(best, second, "one seed" if half is None else "decided", found.value, half)


def sentence(found: Order, against: Against) -> str:
    """One or two plain sentences on the order of the best two."""
    truth = "its own transport's truth" if against == "matched" else "the full path-traced truth"
    interval = found.best.interval(against, "rmse")
    assert interval is not None, "the best row was measured"
    spread = f" ± {number(interval.half, 2)}" if interval.kind in ("student-t", "bootstrap") else ""
    lead = f"{found.best.label} is closest to {truth}, RMSE {number(interval.mean)}{spread}"
    if found.second is None:
        return f"{found.best.label} has RMSE {number(interval.mean)}{spread} against {truth}; nothing else was measured."
    second = found.second.label
    gap = number(found.gap) + (f" ± {number(found.half, 2)}" if found.half is not None else "")
    return {
        "identical": f"{lead}; {second} gives the same bytes: unchanged.",
        "decided": f"{lead}; {second} follows by {gap}, more than the uncertainty over seeds.",
        "within seeds": f"{lead}, but the lead of {gap} over {second} lies within the uncertainty over seeds.",
        "within reference": f"{lead}, but the reference is too noisy to decide the lead of {gap} over {second}.",
        "one seed": f"{lead}; {second} follows by {gap}, on one seed, which allows no statistics.",
        "alone": "",
    }[found.kind]


def too_noisy(rows: Sequence[Row], against: Against) -> list[str]:
    """Labels of rows for which the reference leaves more than 20 % of the pixels undecided."""
    return [r.label for r in rows if any(reference_too_noisy(result.metrics.get(against, {})) for _, result in r.done)]


def path_traced_points(rows: Sequence[Row], row: Row, against: Against) -> list[tuple[float, float]]:
    """(seconds, RMSE) of path tracing on the row's device and size: of the row's transport, or against full of full transport."""
    transport = row.transport if against == "matched" else "full"
    points = []
    for other in rows:
        error = other.interval(against, "rmse")
        same = (other.device, other.size, other.transport) == (row.device, row.size, transport)
        if other.method == PATH_TRACER and same and error is not None and other.seconds is not None:
            points.append((other.seconds.median, error.mean))
    return points


def speed_sentence(rows: Sequence[Row], against: Against) -> str | None:
    """What path tracing reached in the time of the closest other method; None where it wasn't measured on the same device."""
    for row in ranking([r for r in rows if r.method != PATH_TRACER], against)[:1]:
        error = row.interval(against, "rmse")
        if error is None or row.seconds is None:
            return None
        ratio = equal_time((row.seconds.median, error.mean), path_traced_points(rows, row, against)).error_ratio
        if ratio is not None:
            return f"In the {seconds(row.seconds.median)} of {row.label}, path tracing has {number(ratio)} × its RMSE."
    return None


def summary(rows: Sequence[Row], decides: Decides) -> list[str]:
    """All that can be said of a scene, most important first; says so when nothing was measured."""
    failed = sum(len(row.failed) for row in rows)
    total = sum(len(row.cells) for row in rows)
    orders = [(against, order(rows, against, decides)) for against in AGAINST]
    sentences = [sentence(found, against) for against, found in orders if found is not None]
    if not sentences:
        sentences.append("All cells failed." if total and failed == total else "Nothing was compared with a reference.")
    speed = speed_sentence(rows, "full")
    if speed:
        sentences.append(speed)
    for against in AGAINST:
        labels = too_noisy(rows, against)
        if labels:
            share = f"{100 * TOO_NOISY:.0f} %"
            sentences.append(
                f"Reference too noisy ({against}): more than {share} of the pixels are undecided for {', '.join(labels)}."
            )
    if failed and failed < total:
        sentences.append(f"{failed} of {total} cells failed.")
    return sentences


def best_values(rows: Sequence[Row], against: Against, metric_id: str) -> set[str]:
    """Keys of the rows with the best value of a metric, by the registry's direction; several on a tie, none when all are equal."""
    metric = METRICS[metric_id]
    found = {row.key: metric.badness(i.mean) for row in rows if (i := row.interval(against, metric_id)) is not None}
    if len(set(found.values())) < 2:
        return set()
    return {key for key, value in found.items() if value == min(found.values())}
