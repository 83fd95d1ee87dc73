"""Records in time: what a record says at a frame after its own.

    E_k(t) = E_k + ∇ᵗE (t - t_k),  and likewise both spatial gradients                              Gautron 2006, equation 5.9

| trend | ∇ᵗ | |
| --- | --- | --- |
| none | 0 | frozen |
| extrapolated | E_1 - E_0, from the frame foreseen | one pass |
| interpolated | (E_l - E_k) / (t_l - t_k), l the successor at the same place | continuous where l takes over |

The printed formula has p_k - p beside the translation gradient; its spatial part here is that of `caching.splat`, with p - p_k.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Records, Sites

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Gradients = Literal["none", "extrapolated", "interpolated"]


@dataclass(frozen=True, eq=False)
class Trends:
    """Change per frame of K records: irradiance (K, 3), translation and rotation (K, 3, 3)."""

    irradiance: F64
    translation: F64
    rotation: F64

    @staticmethod
    def between(first: Records, last: Records, frames: F64) -> Trends:
        """Of records that become others at the same places over so many frames (K,)."""
        per = 1 / frames
        return Trends(
            (last.irradiance - first.irradiance) * per[:, None],
            (last.translation - first.translation) * per[:, None, None],
            (last.rotation - first.rotation) * per[:, None, None],
        )

    @staticmethod
    def none(count: int) -> Trends:
        """No change."""
        return Trends(np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3, 3)))

    def rows(self, index: Any) -> Trends:
        """Those of the selected records."""
        return Trends(self.irradiance[index], self.translation[index], self.rotation[index])


@dataclass(frozen=True, eq=False)
class Timed:
    """K records in time. sites: where they are; place (K,): number of the place; born (K,): frame computed; life (K,): frames it
    serves; covered (K,): pixels it reached in its last frame, -1 before; strikes, rest (K,): see `cache`."""

    records: Records
    trends: Trends
    sites: Sites
    place: I64
    born: I64
    life: I64
    covered: I64
    strikes: I64
    rest: I64

    def __len__(self) -> int:
        return len(self.place)

    def rows(self, index: Any) -> Timed:
        """The selected ones."""
        columns: Any = {
            f.name: value.rows(index) if hasattr(value, "rows") else value[index]
            for f in fields(self)
            for value in (getattr(self, f.name),)
        }
        return Timed(**columns)

    @staticmethod
    def of(records: Records, trends: Trends, sites: Sites, place: I64, frame: int, life: I64, strikes: I64, rest: I64) -> Timed:
        """Records made in one frame."""
        born, unknown = np.full(len(place), frame), np.full(len(place), -1)
        return Timed(records, trends, sites, place, born, life, unknown, strikes, rest)

    @staticmethod
    def empty() -> Timed:
        """None."""
        nothing, three = np.zeros(0, np.int64), np.zeros((0, 3))
        return Timed(Records.empty(), Trends.none(0), Sites(three, three, three), *(nothing,) * 6)

    @staticmethod
    def joined(*parts: Timed) -> Timed:
        """All of them, in order."""
        filled = [part for part in parts if len(part)]
        if len(filled) < 2:
            return filled[0] if filled else Timed.empty()
        columns: Any = {f.name: [getattr(part, f.name) for part in filled] for f in fields(Timed)}
        trends = (np.concatenate([getattr(t, name) for t in columns["trends"]]) for name in Trends.__dataclass_fields__)
        joined: Any = {
            "records": Records.joined(columns["records"]),
            "trends": Trends(*trends),
            "sites": Sites(*(np.concatenate(column) for column in zip(*columns["sites"], strict=True))),
        }
        joined |= {name: np.concatenate(column) for name, column in columns.items() if name not in joined}
        return Timed(**joined)

    @property
    def last(self) -> I64:
        """Last frame that each serves, (K,)."""
        return self.born + self.life - 1

    def at(self, frame: int) -> Records:
        """What they say at a frame. Irradiance stays ≥ 0."""
        dt = (frame - self.born).astype(np.float64)
        trends = self.trends
        return replace(
            self.records,
            irradiance=np.maximum(self.records.irradiance + trends.irradiance * dt[:, None], 0),
            translation=self.records.translation + trends.translation * dt[:, None, None],
            rotation=self.records.rotation + trends.rotation * dt[:, None, None],
        )

    def with_trends(self, index: Any, trends: Trends) -> Timed:
        """The same with other trends at the selected ones."""
        columns: Any = {}
        for name in Trends.__dataclass_fields__:
            columns[name] = getattr(self.trends, name).copy()
            columns[name][index] = getattr(trends, name)
        return replace(self, trends=Trends(**columns))


def succeeded(records: Timed, waiting: NDArray[np.bool_], successors: Timed, frame: int) -> tuple[Timed, NDArray[np.bool_]]:
    """Records whose life ended before `frame`, with trends towards their successors, born then; and which still wait, (K,).

    waiting (K,): which waited so far. Those whose life is over and that have no successor keep their trends.
    """
    over = waiting & (records.last < frame)
    index = np.flatnonzero(over)
    found = np.searchsorted(successors.place, records.place[index]) if len(successors) else np.zeros(len(index), np.int64)
    found = np.minimum(found, max(len(successors) - 1, 0))
    has = successors.place[found] == records.place[index] if len(successors) else np.zeros(len(index), bool)
    index, found = index[has], found[has]
    frames = (successors.born[found] - records.born[index]).astype(np.float64)
    trends = Trends.between(records.records.rows(index), successors.records.rows(found), frames)
    return records.with_trends(index, trends), waiting & ~over
