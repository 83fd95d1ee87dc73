"""Cells and results gathered into table rows: one per scene × method configuration × device, over seeds and frames."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from reports.folder import Cell, Evaluation
from reports.results import Result
from reports.statistics import Interval, interval

Against = Literal["matched", "full"]
AGAINST: tuple[Against, ...] = ("matched", "full")
PATH_TRACER = "pt"


def device_string(result: Result) -> str:
    """What the render ran on, as one line; results of different strings are never compared by speed."""
    named = ("gl", "cpu", "threads")
    parts = [result.device[k] + (" threads" if k == "threads" else "") for k in named if result.device.get(k)]
    return " · ".join(parts) or "unknown device"


@dataclass(frozen=True)
class Span:
    """Median, least and greatest of n measured values."""

    median: float
    low: float
    high: float
    n: int


@dataclass(frozen=True, eq=False)
class Row:
    """All seeds and frames of one configuration in one scene on one device. `cells` holds failed ones too; `results` is by id."""

    key: str
    scene: str
    label: str
    method: str
    transport: str
    size: tuple[int, int]
    device: str
    settings: Mapping[str, Any]
    cells: tuple[Cell, ...]
    results: Mapping[str, Result]

    @cached_property
    def done(self) -> list[tuple[Cell, Result]]:
        """Cells that have a result, by seed and frame."""
        pairs = [(c, self.results[c.id]) for c in self.cells if c.id in self.results]
        return sorted(pairs, key=lambda p: (p[0].seed, p[0].frame))

    @cached_property
    def frames(self) -> list[int]:
        """Frames that have a result."""
        return sorted({c.frame for c, _ in self.done})

    @cached_property
    def failed(self) -> list[Cell]:
        """Cells without a result."""
        return [c for c in self.cells if c.id not in self.results]

    @cached_property
    def unchanged(self) -> bool:
        """Whether two or more seeds gave the same bytes in every frame."""
        by_frame: dict[int, list[str]] = defaultdict(list)
        for cell, result in self.done:
            by_frame[cell.frame].append(result.frame_hash)
        return bool(by_frame) and all(len(h) > 1 and h[0] != "" and len(set(h)) == 1 for h in by_frame.values())

    def values(self, against: Against, metric: str) -> list[float]:
        """One number per seed: the metric's mean over frames; seeds where it is not defined are left out."""
        by_seed: dict[int, list[float]] = defaultdict(list)
        for cell, result in self.done:
            value = result.metrics.get(against, {}).get(metric)
            if value is not None:
                by_seed[cell.seed].append(value)
        return [float(np.mean(v)) for _, v in sorted(by_seed.items())]

    def interval(self, against: Against, metric: str) -> Interval | None:
        """Mean over seeds with its uncertainty; None where the metric was not measured."""
        values = self.values(against, metric)
        return interval(values) if values else None

    def floor(self, against: Against, metric: str = "rmse") -> float | None:
        """Mean over cells of what the reference's noise alone measures."""
        values = [v for _, r in self.done if (v := r.noise_floor.get(against, {}).get(metric)) is not None]
        return float(np.mean(values)) if values else None

    @cached_property
    def seconds(self) -> Span | None:
        """Wall seconds of the render stage, over seeds and frames."""
        values = [r.seconds for _, r in self.done if r.timings]
        return Span(float(np.median(values)), min(values), max(values), len(values)) if values else None

    def total(self, field: str) -> float | None:
        """Median over results of the render stage's sum of a timing field (`cpu_s`, `gpu_s`); None where a pass lacks it."""
        sums = []
        for _, result in self.done:
            parts = [t.get(field) for t in result.timings if t.get("stage") == "render"]
            if parts and all(p is not None for p in parts):
                sums.append(math.fsum(p for p in parts if p is not None))
        return float(np.median(sums)) if sums else None

    @cached_property
    def counters(self) -> dict[str, int]:
        """Work counts, median over seeds and frames."""
        names = sorted({n for _, r in self.done for n in r.counters})
        return {n: int(np.median([r.counters[n] for _, r in self.done if n in r.counters])) for n in names}

    def sentences(self, field: Literal["approximations", "notes"]) -> list[str]:
        """Distinct approximations or notes, in the order met."""
        return list(dict.fromkeys(s for _, r in self.done for s in getattr(r, field)))


def _unique(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def gather(evaluation: Evaluation, results: Mapping[str, Result]) -> dict[str, list[Row]]:
    """Rows by scene name, in the plan's order. A failed cell joins the first row of its configuration."""
    groups: dict[tuple[str, str, str, str, int, int], list[Cell]] = defaultdict(list)
    for cell in evaluation.cells:
        groups[cell.scene, cell.method, cell.label, cell.transport, cell.width, cell.height].append(cell)
    sizes = {s.name: {(c.width, c.height) for c in evaluation.cells if c.scene == s.name} for s in evaluation.scenes}
    rows: dict[str, list[Row]] = {scene.name: [] for scene in evaluation.scenes}
    for number, ((scene, method, label, transport, width, height), cells) in enumerate(groups.items()):
        if len(sizes[scene]) > 1:
            label = f"{label} · {width}×{height}"
        devices = _unique(device_string(results[c.id]) for c in cells if c.id in results) or [""]
        for k, device in enumerate(devices):
            own = [
                c for c in cells if (c.id in results and device_string(results[c.id]) == device) or (c.id not in results and k == 0)
            ]
            settings = next((results[c.id].settings for c in own if c.id in results), own[0].settings)
            found = {c.id: results[c.id] for c in own if c.id in results}
            row = Row(f"r{number}-{k}", scene, label, method, transport, (width, height), device, settings, tuple(own), found)
            rows[scene].append(row)
    return rows
