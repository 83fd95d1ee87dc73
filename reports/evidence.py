"""What needs the images themselves: error budgets, and whether a reference can decide between two methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.images import display_values
from reports.folder import SceneInfo
from reports.rows import AGAINST, Against, Row
from reports.sequences import compared
from reports.statistics import Budget, Truth, budget, mean_budget, reference_decides, truth
from reports.stored import Images, StoredReference


class Evidence:
    """Answers about one scene; reads each image when it is asked for."""

    def __init__(self, images: Images, scene: SceneInfo) -> None:
        self.images, self.scene = images, scene
        self._truths: dict[str, Truth] = {}

    def reference(self, row: Row, frame: int, against: Against) -> StoredReference | None:
        """The row's matched or full reference of a frame."""
        transport = row.transport if against == "matched" else "full"
        return self.images.reference(self.scene.name, frame, transport, row.size)

    def seeds(self, row: Row, frame: int) -> list[NDArray[np.float64]]:
        """Display values of every seed's image of a frame."""
        found = (self.images.frame(c) for c, _ in row.done if c.frame == frame)
        return [display_values(image, self.scene.exposure) for image in found if image is not None]

    def budget(self, row: Row) -> Budget | None:
        """The row's error budget, mean over the frames that have both references; None without those or without an image."""
        found = []
        for frame in row.frames:
            matched, full = (self.reference(row, frame, a) for a in AGAINST)
            if matched is None or full is None:
                continue
            images = self.seeds(row, frame)
            if not images:
                return None
            truth_matched, truth_full = self._truth(matched), self._truth(full)
            floor = float(np.mean(truth_matched.spread**2))
            found.append(budget(images, truth_matched.display, truth_full.display, floor))
        return mean_budget(found) if found else None

    def decides(self, a: Row, b: Row, against: Against) -> bool | None:
        """Whether the references can decide between two rows in the first frame that both have compared; None when they can't be
        asked.
        """
        frames = [f for f in compared(a) if f in compared(b)]
        if not frames or a.size != b.size:
            return None
        references = [self.reference(row, frames[0], against) for row in (a, b)]
        images = [self.seeds(row, frames[0]) for row in (a, b)]
        if references[0] is None or references[1] is None or not all(images):
            return None
        means = [np.mean(seeds, axis=0) for seeds in images]
        return reference_decides(means[0], means[1], self._truth(references[0]), self._truth(references[1]))

    def _truth(self, stored: StoredReference) -> Truth:
        if stored.info.id not in self._truths:
            self._truths[stored.info.id] = truth(stored.mean, stored.variance, self.scene.exposure)
        return self._truths[stored.info.id]


@dataclass(frozen=True)
class Bar:
    """One part of a stacked bar: its kind, value, and place in per cent of the drawing's width."""

    kind: str
    name: str
    value: float
    left: float
    width: float


def bars(budgets: Sequence[tuple[Row, Budget]]) -> tuple[float, list[tuple[Row, Budget, list[Bar]]]]:
    """Place the parts of every budget on one common scale; parts below 0 stand left of the zero line, whose place is returned (per
    cent).
    """
    stacks = [(row, found, _parts(found)) for row, found in budgets]
    most = max((sum(v for *_, v in parts if v > 0) for *_, parts in stacks), default=0.0)
    least = min((sum(v for *_, v in parts if v < 0) for *_, parts in stacks), default=0.0)
    scale = 100 / (most - least) if most > least else 0.0
    zero = -least * scale
    drawn = []
    for row, found, parts in stacks:
        right = left = zero
        placed = []
        for kind, name, value in parts:
            width = abs(value) * scale
            if value < 0:
                left -= width
            placed.append(Bar(kind, name, value, left if value < 0 else right, width))
            right += width if value > 0 else 0.0
        drawn.append((row, found, placed))
    return zero, drawn


def _parts(found: Budget) -> list[tuple[str, str, float]]:
    noise = [] if found.noise is None else [("noise", "estimator noise", found.noise)]
    name = "method bias" if found.noise is not None else "method bias and noise (one seed)"
    floor = ("floor", "reference noise", found.floor)
    return [*noise, ("bias", name, found.bias), floor, ("model", "transport model", found.model)]
