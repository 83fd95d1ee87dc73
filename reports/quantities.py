"""What changed between two rows of the same configuration: errors measured anew from the images, work counts, costs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reports.change import Quantity
from reports.folder import Cell
from reports.metrics import Pair
from reports.paired import paired
from reports.registry import METRICS
from reports.results import Result
from reports.rows import Row
from reports.stored import Images, StoredReference

# Changes that reordered float32 sums can make are not changes of a method. Sums of a thousand terms round by up to 1e-4, relative;
# through the sRGB curve's power 1/2.4 that moves display values by at most 255 · 1e-4 / 2.4 = 0.011. RMSE is a norm: it moves by
# no more than the root mean square of what the image moves by; flicker sums two such moves. Mean bias is linear. Each of SSIM's two
# factors is a ratio of such values.
SMALLEST = {"rmse": 0.011, "flicker": 0.022, "mean_bias": 1e-4, "ssim": 2e-4}
# Wall clocks of quiet machines repeat to 2 %: less work than half of that buys no measurable time.
SMALLEST_WORK = 0.01
DECIDING = ("rmse", "ssim", "mean_bias", "flicker")
SHOWN = ("over_2pct", "rel_mse")
SLOW = ("flip_hdr",)  # of the first seed alone

Seeds = dict[int, list[tuple[Cell, Result]]]


@dataclass(frozen=True, eq=False)
class Match:
    """The same configuration in two runs, reduced to common seeds and frames."""

    before: Seeds
    after: Seeds

    @property
    def seeds(self) -> list[int]:
        """Common seeds."""
        return sorted(self.after)

    @property
    def frames(self) -> list[int]:
        """Common frames."""
        return sorted({cell.frame for pairs in self.after.values() for cell, _ in pairs})

    def cells(self, seed: int) -> list[tuple[Cell, Cell]]:
        """Earlier and later cell of every frame of a seed."""
        return [(old, new) for (old, _), (new, _) in zip(self.before[seed], self.after[seed], strict=True)]

    @property
    def same_bytes(self) -> bool:
        """Whether every common cell has the same frame hash in both runs."""
        hashes = [[r.frame_hash for s in self.seeds for _, r in side[s]] for side in (self.before, self.after)]
        return bool(hashes[0]) and all(hashes[0]) and hashes[0] == hashes[1]


def match(before: Row, after: Row) -> Match:
    """Common cells of two rows; only seeds that have every common frame in both count."""
    sides = [{(c.seed, c.frame): (c, r) for c, r in row.done} for row in (before, after)]
    common = sorted(sides[0].keys() & sides[1].keys())
    frames = {frame for _, frame in common}
    by_seed = defaultdict(set)
    for seed, frame in common:
        by_seed[seed].add(frame)
    whole = [seed for seed, found in sorted(by_seed.items()) if found == frames]
    picked: list[Seeds] = [{s: [side[s, f] for f in sorted(frames)] for s in whole} for side in sides]
    return Match(*picked)


def errors(found: Match, before: Images, after: Images, exposure: float) -> list[Quantity] | None:
    """Error metrics of both runs' images against the same references, those of the later run, by today's definitions.

    Frames without a reference are left out. None where an image or every reference is missing.
    """
    measured: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for seed in found.seeds:
        names = (*DECIDING, *SHOWN, *(SLOW if seed == found.seeds[0] else ()))
        values = _seed_errors(names, found.cells(seed), before, after, exposure)
        if values is None:
            return None
        for key, pair in values.items():
            measured[key].append(pair)
    quantities = []
    for (against, name), pairs in measured.items():
        if len(pairs) == len(found.seeds) or name in SLOW:
            quantities.append(_error(against, name, [b for b, _ in pairs], [a for _, a in pairs]))
    return quantities


def _seed_errors(
    names: Sequence[str], cells: Sequence[tuple[Cell, Cell]], before: Images, after: Images, exposure: float
) -> dict[tuple[str, str], tuple[float, float]] | None:
    """(before, after) of metrics of one seed, mean over frames; None where an image or every reference is missing."""
    values: dict[tuple[str, str], tuple[float, float]] = {}
    for against, wanted in (("matched", names), ("full", ("rmse",))):
        pairs: dict[int, tuple[Pair, Pair]] = {}
        for old, new in cells:
            reference = _reference(new, against, before, after)
            images = before.frame(old), after.frame(new)
            if images[0] is None or images[1] is None:
                return None
            if reference is not None:
                pairs[new.frame] = reference.pair(images[0], exposure), reference.pair(images[1], exposure)
        if not pairs:
            return None
        for name in wanted:
            b, a = (_measure(name, {frame: pair[side] for frame, pair in pairs.items()}) for side in (0, 1))
            if b is not None and a is not None:
                values[against, name] = (b, a)
    return values


def _reference(cell: Cell, against: str, before: Images, after: Images) -> StoredReference | None:
    """What both runs' images of a cell are compared with, the later run's if it has one; not every frame of a sequence does."""
    wanted = (cell.scene, cell.frame, cell.transport if against == "matched" else "full", (cell.width, cell.height))
    return after.reference(*wanted) or before.reference(*wanted)


def _measure(name: str, pairs: Mapping[int, Pair]) -> float | None:
    """A metric's mean over frames, or for one of sequences over pairs of consecutive frames; None where it isn't defined."""
    metric = METRICS[name]
    if metric.change is not None:
        values = [metric.change(pairs[frame - 1], pair) for frame, pair in pairs.items() if frame - 1 in pairs]
    else:
        assert metric.function is not None, "a metric is of one frame or of two"
        values = [metric.function(pair) for pair in pairs.values()]
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known and len(known) == len(values) else None


def _error(against: str, name: str, before: Sequence[float], after: Sequence[float]) -> Quantity:
    metric = METRICS[name]
    means = float(np.mean(before)), float(np.mean(after))
    change = paired(before, after)
    deciding = against == "matched" and name in DECIDING
    # How large a change is, on one scale: relative to the error there was; for signed energy the change itself.
    scale = {"mean_bias": 1.0, "ssim": max(1.0 - means[0], 0.01)}.get(
        name, max(abs(means[0]), 1.0 if name != "over_2pct" else 0.01)
    )
    return Quantity(
        id=f"{against}.{name}", name=metric.name if against == "matched" else f"{metric.name}, full", seeds=change.n,
        kind="error" if deciding else "information", before=means[0], after=means[1], change=change.change,
        relative=None if name in ("mean_bias", "ssim") else _relative(means[0], change.change), size=abs(change.change) / scale,
        low=change.low, high=change.high, p=change.p if deciding else None, smallest=SMALLEST.get(name, 0.0),
        worse=metric.badness(means[1]) > metric.badness(means[0]),
    )  # fmt: skip


def work(found: Match) -> list[Quantity]:
    """Exact work counts that both runs have, summed over frames; more work is worse."""
    sides = (found.before, found.after)
    names = set.intersection(*(_counters(side) for side in sides))
    return [_count(name, *(_work_per_seed(side, name) for side in sides)) for name in sorted(names)]


def _counters(side: Seeds) -> set[str]:
    return {name for pairs in side.values() for _, result in pairs for name in result.counters}


def _work_per_seed(side: Seeds, name: str) -> list[float]:
    return [float(sum(result.counters.get(name, 0) for _, result in side[seed])) for seed in sorted(side)]


def counters_apart(found: Match) -> tuple[list[str], list[str]]:
    """Names of counters that only the later, and only the earlier run has."""
    before, after = _counters(found.before), _counters(found.after)
    return sorted(after - before), sorted(before - after)


def _count(name: str, before: Sequence[float], after: Sequence[float]) -> Quantity:
    change = paired(before, after)
    means = float(np.mean(before)), float(np.mean(after))
    relative = _relative(means[0], change.change)
    size = abs(relative) if relative is not None else float(change.change != 0)
    return Quantity(
        id=f"counters.{name}", name=name.replace("_", " "), kind="work", before=means[0], after=means[1], change=change.change,
        relative=relative, size=size, low=change.low, high=change.high, p=change.p, seeds=change.n, worse=change.change > 0,
        smallest=SMALLEST_WORK * means[0],
    )  # fmt: skip


def costs(found: Match) -> list[Quantity]:
    """Wall seconds of the render stage and peak memory: times of two runs are information, never a verdict."""
    fields: Mapping[str, tuple[str, Callable[[Result], float]]] = {
        "wall_s": ("Time", lambda r: r.seconds),
        "peak_rss_bytes": ("Peak memory", lambda r: float(r.peak_rss_bytes)),
    }
    quantities = []
    for key, (name, read) in fields.items():
        before, after = (float(np.median([read(r) for s in side.values() for _, r in s])) for side in (found.before, found.after))
        if before > 0 and after > 0:
            quantities.append(
                Quantity(
                    id=key, name=name, kind="information", before=before, after=after, change=after - before,
                    relative=after / before - 1, size=0.0, seeds=len(found.seeds), worse=after > before,
                )
            )  # fmt: skip
    return quantities


def _relative(before: float, change: float) -> float | None:
    return change / abs(before) if before != 0 else None
