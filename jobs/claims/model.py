"""What a published claim is, what measuring it answers, and the rule that turns figures into one word.

A row has a verdict of its own. Let p be the published value, w = `within`·|p| the stated tolerance (rounding of a printed figure,
what a calibration can reach), and [low, high] the 95 % interval of the mean over seeds:

| direction | better         | holds          | deviates       |
| --------- | -------------- | -------------- | -------------- |
| `higher`  | low > p + w    | high ≥ p - w   | high < p - w   |
| `lower`   | high < p - w   | low ≤ p + w    | low > p + w    |
| `equal`   |                | both of them   | otherwise      |

Rows without a published value, and those whose figure belongs to another machine or scene, are shown but not compared. The claim
`deviates` where a row does, is `better` where none does and one is better, `reproduced` where all hold, and `not comparable` where
no row can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, ConfigDict

from reports.statistics import Interval, interval

if TYPE_CHECKING:
    from jobs.claims.bench import Bench

Direction = Literal["higher", "lower", "equal"]
Status = Literal["reproduced", "better", "deviates", "not comparable"]
WORDS: dict[Direction, str] = {"higher": "at least", "lower": "at most", "equal": "about"}


@dataclass(frozen=True)
class Row:
    """One published figure beside the measured one; made by `row`."""

    id: str
    quantity: str
    unit: str
    published: float | None
    measured: Interval
    direction: Direction
    within: float
    comparable: bool

    @property
    def verdict(self) -> Status:
        """How the measured figure stands to the published one, by the rule above."""
        if self.published is None or not self.comparable:
            return "not comparable"
        slack = self.within * abs(self.published)
        low, high = self.measured.low - self.published, self.measured.high - self.published
        above, below = high >= -slack, low <= slack
        holds = {"higher": above, "lower": below, "equal": above and below}[self.direction]
        better = {"higher": low > slack, "lower": high < -slack, "equal": False}[self.direction]
        return "better" if better else "reproduced" if holds else "deviates"

    def sentence(self) -> str:
        """Measured and published in words."""
        m = self.measured
        return f"{self.id} = {m.mean:.4g} [{m.low:.4g}, {m.high:.4g}], published {WORDS[self.direction]} {self.published:.4g}"


def row(
    id: str, quantity: str, unit: str, published: float | None, values: Sequence[float], direction: Direction = "equal",
    *, within: float = 0.0, comparable: bool = True,
) -> Row:  # fmt: skip
    """A row from measured values, one for each seed (or repeat). within ≥ 0: relative tolerance on the published value.

    Raises ValueError for no values or a negative tolerance.
    """
    if within < 0:
        raise ValueError(f"within must be 0 or more, got {within}")
    return Row(id, quantity, unit, published, interval(values), direction, within, comparable)


def held(id: str, quantity: str, outcomes: Sequence[bool], *, comparable: bool = True) -> Row:
    """A row for what a publication says in words: in which share of cases it is so, published as 1. Raises ValueError for none."""
    return row(id, quantity, "share of cases", 1.0, [float(o) for o in outcomes], "higher", comparable=comparable)


@dataclass(frozen=True)
class Measurement:
    """What measuring a claim gave. scene: what was rendered, in words; notes: sentences on how it differs from the publication."""

    scene: str
    rows: Sequence[Row]
    notes: Sequence[str] = field(default=())

    @property
    def status(self) -> Status:
        """The claim's one word, by the rule above."""
        verdicts = {r.verdict for r in self.rows}
        order: tuple[Status, ...] = ("deviates", "better", "reproduced")
        return next((word for word in order if word in verdicts), "not comparable")

    @property
    def why(self) -> str:
        """The figures that decided, then the notes."""
        compared = [r for r in self.rows if r.verdict != "not comparable"]
        decisive = [r.sentence() for r in compared if r.verdict == self.status and self.status in ("deviates", "better")]
        held = f"{sum(r.verdict != 'deviates' for r in compared)} of {len(compared)} compared figures hold"
        return ". ".join([held + (": " if decisive else "") + "; ".join(decisive), *self.notes]) + "."


@dataclass(frozen=True)
class PublishedClaim:
    """A published table or figure. `measure` renders and answers figures; it runs in a child process of at most half an hour."""

    id: str
    title: str
    source: str
    measure: Callable[[Bench], Measurement]


class AnswerRow(BaseModel):
    """A row as printed; low and high bound the mean over seeds (95 %)."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    id: str
    quantity: str
    unit: str
    published: float | None
    measured: float
    low: float
    high: float


class Answer(BaseModel):
    """The document of one claim that `luxmeter reproduce --json` prints."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    claim: str
    status: Status
    why: str
    scene: str
    device: str
    command: str
    rows: list[AnswerRow]

    @classmethod
    def of(cls, claim: str, found: Measurement, device: str) -> Answer:
        """The answer to a measured claim. Raises ValueError where two rows share an id."""
        ids = [r.id for r in found.rows]
        if len(set(ids)) != len(ids):
            raise ValueError(f"{claim}: row ids are not unique: {ids}")
        rows = [
            AnswerRow(
                id=r.id, quantity=r.quantity, unit=r.unit, published=r.published, measured=r.measured.mean, low=r.measured.low,
                high=r.measured.high,
            )
            for r in found.rows
        ]  # fmt: skip
        command = f"luxmeter reproduce {claim}"
        return cls(claim=claim, status=found.status, why=found.why, scene=found.scene, device=device, command=command, rows=rows)
