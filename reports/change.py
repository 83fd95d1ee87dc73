"""What a comparison of two runs says, as data: `comparison.json` is one `Comparison`."""

from __future__ import annotations

from collections import Counter
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, computed_field

Verdict = Literal["failed", "regression", "undecided", "improvement", "changed-within-noise", "new", "gone", "unchanged"]
VERDICTS: tuple[Verdict, ...] = (
    "failed", "regression", "undecided", "improvement", "changed-within-noise", "new", "gone", "unchanged",
)  # fmt: skip
Direction = Literal["worse", "better", "within noise", "same", "undecided", "information"]


class Quantity(BaseModel):
    """One number before and after, paired over seeds.

    kind: error metrics against the matched reference, exact work counts, and costs or other metrics for information alone.
    relative: change over |before|, None where that says nothing. low, high: 95 % interval of the change, None on one seed.
    p: against no change; adjusted: after Holm over the whole comparison; both None where nothing is tested.
    """

    model_config = ConfigDict(extra="forbid")
    id: str
    name: str
    kind: Literal["error", "work", "information"]
    before: float
    after: float
    change: float
    relative: float | None
    size: float
    low: float | None = None
    high: float | None = None
    p: float | None = None
    adjusted: float | None = None
    seeds: int
    worse: bool
    smallest: float = 0.0
    direction: Direction = "information"


class RowChange(BaseModel):
    """One scene × method configuration × size in two runs, over their common seeds and frames. `key` is unique and file-name safe.

    before_cells, after_cells: ids of the cells that stand for the images (first common seed), frame by frame.
    """

    model_config = ConfigDict(extra="forbid")
    key: str
    part: str
    scene: str
    method: str
    label: str
    width: int
    height: int
    seeds: list[int] = []
    frames: list[int] = []
    verdict: Verdict
    newly_failed: bool = False
    reasons: list[str] = []
    size: float = 0.0
    quantities: list[Quantity] = []
    settings: dict[str, tuple[Any, Any]] = {}
    before_cells: list[str] = []
    after_cells: list[str] = []


class ReferenceChange(BaseModel):
    """A reference whose bytes differ between the runs.

    energy: relative change of its mean luminance, p against no change; spread: mean squared difference of luminance over the sum of
    both variances, 1 where only noise differs.
    """

    model_config = ConfigDict(extra="forbid")
    part: str
    id: str
    scene: str
    transport: str
    frame: int
    energy: float | None = None
    p: float | None = None
    adjusted: float | None = None
    spread: float | None = None
    verdict: Verdict
    reason: str


class RunSide(BaseModel):
    """Where one side of a comparison comes from: ids and dates of its evaluations, devices."""

    model_config = ConfigDict(extra="forbid")
    evaluations: list[str]
    created: str
    devices: list[str]
    versions: dict[str, str] = {}


class Comparison(BaseModel):
    """Two runs compared. Rows stand in the order of their gravity, largest change first. `tests` is the number of Holm's family."""

    model_config = ConfigDict(extra="forbid")
    before: RunSide | None
    after: RunSide
    level: float
    tests: int
    rows: list[RowChange]
    references: list[ReferenceChange]

    @computed_field  # type: ignore[prop-decorator]
    @property
    def counts(self) -> dict[str, int]:
        """Rows by verdict, those that occur."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in VERDICTS if found[verdict]}

    @computed_field  # type: ignore[prop-decorator]
    @property
    def regressed(self) -> bool:
        """Whether a row got worse beyond noise or newly fails, or a reference moved beyond its noise."""
        moved = any(reference.verdict == "regression" for reference in self.references)
        return moved or any(row.verdict == "regression" or row.newly_failed for row in self.rows)
