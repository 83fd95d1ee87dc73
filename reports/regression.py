"""Compare two runs: which cells changed, by how much, and whether that is more than noise.

The order of the questions is fixed. Are the images the same bytes? Then the row is *unchanged*, and no statistics are made. Is the
change larger than rounding makes, and larger than chance makes (paired over seeds, Holm over all tests of the comparison)? Then the
row is a *regression* or an *improvement*; both at once count as a regression. Work counts are judged like errors; times never are.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from reports.change import VERDICTS, Comparison, Quantity, ReferenceChange, RowChange, RunSide, Verdict
from reports.folder import Evaluation, read
from reports.format import count, number, percent
from reports.moved import references_moved
from reports.paired import holm
from reports.quantities import Match, costs, counters_apart, errors, match, work
from reports.results import Result
from reports.rows import Row, gather
from reports.runs import evaluation_folders
from reports.stored import Images

# One false alarm in a hundred nights on which every image changed by chance alone.
LEVEL = 0.01


@dataclass(frozen=True, eq=False)
class Side:
    """One evaluation folder, read."""

    folder: Path
    evaluation: Evaluation
    results: Mapping[str, Result]
    images: Images
    rows: Mapping[tuple[str, ...], Row]
    exposures: Mapping[str, float]

    @classmethod
    def of(cls, folder: Path) -> Side:
        """Read an evaluation folder; raises as `reports.folder.read`."""
        evaluation, results = read(folder)
        rows: dict[tuple[str, ...], Row] = {}
        for row in (r for own in gather(evaluation, results).values() for r in own):
            key = (row.scene, row.method, row.label, f"{row.size[0]}x{row.size[1]}")
            rows[(*key, str(sum(k[:4] == key for k in rows)))] = row
        return cls(folder, evaluation, results, Images(folder, evaluation), rows, {s.name: s.exposure for s in evaluation.scenes})


def compare(before: Path | None, after: Path) -> Comparison:
    """Compare two evaluation folders, or two run folders part by part; without `before` everything is new.

    Nothing is written; the answer depends on the two folders alone. Raises FileNotFoundError for a folder that holds no evaluation.
    """
    olds = {} if before is None else {part: Side.of(f) for part, f in evaluation_folders(before).items()}
    news = {part: Side.of(f) for part, f in evaluation_folders(after).items()}
    rows: list[RowChange] = []
    references: list[ReferenceChange] = []
    for part in dict.fromkeys([*news, *olds]):
        old, new = olds.get(part), news.get(part)
        rows += _rows(part, old, new)
        if old is not None and new is not None:
            references += references_moved(part, old.images, old.evaluation, new.images, new.evaluation)
    tests = _decide(rows, references)
    rows.sort(key=lambda r: (VERDICTS.index(r.verdict), not r.newly_failed, -r.size))
    return Comparison(
        before=_side(olds.values()) if olds else None, after=_side(news.values()), level=LEVEL, tests=tests,
        rows=[row.model_copy(update={"key": f"c{k}"}) for k, row in enumerate(rows)], references=references,
    )  # fmt: skip


def _side(sides: Iterable[Side]) -> RunSide:
    sides = list(sides)
    results = [r for side in sides for r in side.results.values()]
    versions = {name: value for r in results for name, value in r.versions.items()}
    return RunSide(
        evaluations=[side.evaluation.id for side in sides],
        created=min((side.evaluation.created for side in sides), default=""),
        devices=list(dict.fromkeys(row.device for side in sides for row in side.rows.values() if row.device)),
        versions=dict(sorted(versions.items())),
    )


def _rows(part: str, old: Side | None, new: Side | None) -> list[RowChange]:
    found = []
    olds, news = old.rows if old else {}, new.rows if new else {}
    for key in dict.fromkeys([*news, *olds]):
        a, b = olds.get(key), news.get(key)
        if b is None:
            assert a is not None, "the key comes from one of the two"
            found.append(_plain(part, a, "gone", "not in the later run"))
        elif b.failed:
            found.append(_failed(part, a, b))
        elif a is None or old is None or new is None:
            found.append(_plain(part, b, "new", "not in the earlier run"))
        else:
            found.append(_changed(part, a, b, old, new))
    return found


def _plain(part: str, row: Row, verdict: Verdict, *reasons: str) -> RowChange:
    return RowChange(
        key="", part=part, scene=row.scene, method=row.method, label=row.label, width=row.size[0], height=row.size[1],
        seeds=sorted({c.seed for c, _ in row.done}), frames=row.frames, verdict=verdict, reasons=list(reasons),
    )  # fmt: skip


def _failed(part: str, a: Row | None, b: Row) -> RowChange:
    """A row with failed cells; those that were done before make it newly failed."""
    done = {(c.seed, c.frame) for c, _ in a.done} if a else set()
    newly = a is None or any((c.seed, c.frame) in done for c in b.failed)
    reasons = [f"{len(b.failed)} of {len(b.cells)} cells failed" + ("" if newly else ", as before")]
    reasons += dict.fromkeys(c.error or c.state for c in b.failed)
    return _plain(part, b, "failed", *reasons).model_copy(update={"newly_failed": newly})


def _changed(part: str, a: Row, b: Row, old: Side, new: Side) -> RowChange:
    """A row that both runs have: measured, not yet judged where bytes differ."""
    hashes = [{r.scene_hash for _, r in row.done} for row in (a, b)]
    if hashes[0] != hashes[1]:
        return _plain(part, b, "new", "the scene itself has changed since: not comparable")
    if a.transport != b.transport:
        return _plain(part, b, "new", f"simulated {a.transport} before, now {b.transport}: not comparable")
    found = match(a, b)
    if not found.seeds:
        return _plain(part, b, "new", "no seed and frame in common with the earlier run")
    row = _plain(part, b, "unchanged").model_copy(
        update={
            "seeds": found.seeds, "frames": found.frames,
            "settings": {
                name: (a.settings.get(name), b.settings.get(name))
                for name in sorted({*a.settings, *b.settings}) if a.settings.get(name) != b.settings.get(name)
            },
            "before_cells": [c.id for c, _ in found.before[found.seeds[0]]],
            "after_cells": [c.id for c, _ in found.after[found.seeds[0]]],
        }
    )  # fmt: skip
    if a.device != b.device:
        row.reasons.append(f"another device: {a.device} before, now {b.device}")
    row.reasons += [f"{name} was {old_value}, now {value}" for name, (old_value, value) in row.settings.items()]
    if not found.same_bytes:
        row.verdict = "changed-within-noise"
        row.quantities = _measured(row, found, old, new)
    row.quantities += costs(found) if a.device == b.device else []
    return row


def _measured(row: RowChange, found: Match, old: Side, new: Side) -> list[Quantity]:
    measured = errors(found, old.images, new.images, new.exposures[row.scene])
    if measured is None:
        row.reasons.append("images or references are missing: errors were not compared")
    added, dropped = counters_apart(found)
    row.reasons += [f"new counter {name}" for name in added] + [f"counter {name} is gone" for name in dropped]
    return [*(measured or []), *work(found)]


def _decide(rows: Sequence[RowChange], references: Sequence[ReferenceChange]) -> int:
    """Judge every changed row by Holm's adjusted p-values; returns the number of tests. Exact changes are facts, not tests."""
    tested: list[Quantity | ReferenceChange] = [q for row in rows for q in row.quantities if q.p is not None and q.low != q.high]
    tested += [r for r in references if r.p is not None]
    for one, adjusted in zip(tested, holm([t.p for t in tested if t.p is not None]), strict=True):
        one.adjusted = adjusted
    for row in rows:
        for quantity in row.quantities:
            _direct(quantity)
        if row.verdict == "changed-within-noise":
            _judge(row)
    for reference in references:
        if reference.adjusted is not None and reference.adjusted <= LEVEL:
            reference.verdict = "regression"
            reference.reason = f"its energy moved by {_signed_percent(reference.energy)}, beyond its own noise"
    return len(tested)


def _direct(quantity: Quantity) -> None:
    """Set the direction of one quantity."""
    if quantity.kind == "information":
        return
    if quantity.change == 0:
        quantity.direction = "same"
    elif abs(quantity.change) <= quantity.smallest:
        quantity.direction = "within noise"
    elif quantity.p is None:
        quantity.direction = "undecided"
    elif (quantity.p if quantity.adjusted is None else quantity.adjusted) <= LEVEL:
        quantity.direction = "worse" if quantity.worse else "better"
    else:
        quantity.direction = "within noise"


def _judge(row: RowChange) -> None:
    """Verdict, reasons and size of a row whose bytes differ, from the directions of its quantities."""
    by: dict[str, list[Quantity]] = defaultdict(list)
    for quantity in row.quantities:
        by[quantity.direction].append(quantity)
    verdicts: dict[str, Verdict] = {"worse": "regression", "better": "improvement", "undecided": "undecided"}
    for direction in ("worse", "undecided", "better"):
        by[direction].sort(key=lambda q: -q.size)
    decided = next((d for d in ("worse", "undecided", "better") if by[d]), None)
    if decided is not None:
        row.verdict = verdicts[decided]
    elif not any(q.kind == "error" for q in row.quantities):
        row.verdict = "undecided"
    else:
        row.reasons.append(_harmless(row))
    for direction, note in (("worse", "worse"), ("better", "better"), ("undecided", "one seed allows no statistics")):
        row.reasons += [f"{sentence(q)}: {note}" for q in by[direction]]
    decisive = [*by["worse"], *by["better"], *by["undecided"]]
    row.size = max((q.size for q in decisive or row.quantities if q.kind != "information"), default=0.0)


def _harmless(row: RowChange) -> str:
    deciding = [q for q in row.quantities if q.kind != "information"]
    if deciding and all(q.direction == "same" for q in deciding):
        return "errors and work are the same to the last bit; what differs is a layer that beauty doesn't show"
    return "every change lies within rounding or within the uncertainty over seeds"


def sentence(quantity: Quantity) -> str:
    """One change in words: `RMSE 3.10 → 3.42 (+10 %)`."""
    if quantity.id == "matched.mean_bias":
        return f"{quantity.name} {_signed_percent(quantity.before)} → {_signed_percent(quantity.after)}"
    if quantity.kind == "work":
        values = f"{quantity.name} {_count(quantity.before)} → {_count(quantity.after)}"
    else:
        digits = 5 if quantity.id.endswith("ssim") else 3
        values = f"{quantity.name} {number(quantity.before, digits)} → {number(quantity.after, digits)}"
    return values + (f" ({_signed_percent(quantity.relative)})" if quantity.relative is not None else "")


def _count(value: float) -> str:
    return count(round(value)) if value == round(value) else number(value, 6)


def _signed_percent(value: float | None) -> str:
    return ("+" if value is not None and value > 0 else "") + percent(value)
