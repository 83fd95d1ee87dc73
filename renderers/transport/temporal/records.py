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
from renderers.transport.sampling import frame as frame_of
from renderers.transport.temporal.trends import Trends

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Gradients = Literal["none", "extrapolated", "interpolated"]


@dataclass(frozen=True, eq=False)
class Timed:
    """K records in time. sites: where they are; place (K,): number of the place; born (K,): frame computed; life (K,): frames it
    serves; covered (K,): pixels it reached in its last frame, -1 before; strikes, rest (K,): see `cache`. slope (K, n), span (K,):
    change of light per frame before this record, and over how many frames, see `chords`. made (K, 3): normal of
    the place when it was made, and turn (K, 3, 3): its rotation since, where it goes with a surface that moves."""

    records: Records
    trends: Trends
    sites: Sites
    place: I64
    born: I64
    life: I64
    covered: I64
    strikes: I64
    rest: I64
    slope: F64
    span: I64
    made: F64
    turn: F64

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
    def of(
        records: Records,
        trends: Trends,
        sites: Sites,
        place: I64,
        frame: int,
        life: I64,
        strikes: I64,
        rest: I64,
    ) -> Timed:
        """Records made in one frame, at new places. Coefficients are kept as they are splatted, in float32."""
        born, unknown = np.full(len(place), frame), np.full(len(place), -1)
        count = len(place)
        single, light = _single(records), _single(trends)
        slope, span = np.zeros((count, 3)), np.zeros(count, np.int64)
        return Timed(
            replace(records, **single), replace(trends, **light), sites, place, born, life, unknown, strikes, rest, slope, span,
            sites.normal, unturned(count),
        )  # fmt: skip

    @staticmethod
    def empty() -> Timed:
        """None."""
        nothing, three = np.zeros(0, np.int64), np.zeros((0, 3))
        return Timed(
            Records.empty(), Trends.none(0), Sites(three, three, three), *(nothing,) * 6, three, nothing, three, unturned(0)
        )

    @staticmethod
    def joined(*parts: Timed) -> Timed:
        """All of them, in order."""
        filled = [part for part in parts if len(part)]
        if len(filled) < 2:
            return filled[0] if filled else Timed.empty()
        columns: Any = {f.name: [getattr(part, f.name) for part in filled] for f in fields(Timed)}
        joined: Any = {
            "records": Records.joined(columns["records"]),
            "trends": Trends.joined(columns["trends"]),
            "sites": Sites(*(np.concatenate(column) for column in zip(*columns["sites"], strict=True))),
        }
        joined |= {name: np.concatenate(column) for name, column in columns.items() if name not in joined}
        return Timed(**joined)

    @property
    def tangents(self) -> F64:
        """Axes of their hemispheres (K, 2, 3), which turn with their places."""
        return np.asarray(np.einsum("nij,ntj->nti", self.turn, np.stack(frame_of(self.made), axis=1)))

    @property
    def last(self) -> I64:
        """Last frame that each serves, (K,)."""
        return self.born + self.life - 1

    def at(self, frame: int) -> Records:
        """What they say at a frame. Irradiance stays ≥ 0."""
        records = self.trends.after(self.records, (frame - self.born).astype(np.float64))
        return replace(records, irradiance=np.maximum(records.irradiance, 0))

    def carried(self, index: I64, rotation: F64, shift: F64) -> Timed:
        """The same with the selected places (N,) turned about themselves (N, 3, 3) and moved (N, 3), and their light with them."""
        if not len(index):
            return self
        position, turn = self.sites.position.copy(), self.turn.copy()
        position[index] += shift
        turn[index] = rotation @ turn[index]
        normal, geometric = self.sites.normal.copy(), self.sites.geometric.copy()
        for column in (normal, geometric):
            column[index] = np.einsum("nij,nj->ni", rotation, column[index])
        records = replace(self.records, position=position, normal=normal, **_turned(self.records, index, rotation))
        trends = replace(self.trends, **_turned(self.trends, index, rotation))
        moved = replace(self, records=records, trends=trends, sites=Sites(position, normal, geometric), turn=turn)
        return moved if records.tangents is None else replace(moved, records=replace(records, tangents=moved.tangents))

    def turned_as(self, others: Timed) -> Timed:
        """The same at places that turned as those of others did."""
        return replace(self, made=others.made, turn=others.turn)

    def with_trends(self, index: Any, trends: Trends) -> Timed:
        """The same with other trends at the selected ones."""
        return replace(self, trends=self.trends.updated(index, trends))


def unturned(count: int) -> F64:
    """Rotations (K, 3, 3) that change nothing."""
    return np.broadcast_to(np.eye(3), (count, 3, 3)).copy()


def _single(values: Records | Trends) -> dict[str, Any]:
    """Coefficients and their gradients in float32, where there are any."""
    columns: dict[str, Any] = {name: getattr(values, name) for name in ("coefficients", "coefficient_gradients")}
    return {name: None if column is None else column.astype(np.float32, copy=False) for name, column in columns.items()}


def _turned(values: Records | Trends, index: Any, rotation: F64) -> dict[str, Any]:
    """Spatial gradients, or their trends, with the selected ones turned. Coefficients are those of axes that turn as well."""
    columns: dict[str, Any] = {}
    for name in ("translation", "rotation"):
        columns[name] = getattr(values, name).copy()
        columns[name][index] = np.einsum("nij,ncj->nci", rotation, columns[name][index])
    return columns


def _matched(index: I64, records: Timed, successors: Timed) -> tuple[I64, I64]:
    """Which of the selected records (N,) have a successor, and which it is."""
    if not len(index) or not len(successors):
        return index[:0], index[:0]
    wanted, born = records.last[index] + 1, successors.born
    first = min(int(wanted.min()), int(born.min()))
    frames = max(int(wanted.max()), int(born.max())) - first + 1
    keys = successors.place * frames + born - first
    order = np.argsort(keys)
    sought = records.place[index] * frames + wanted - first
    found = order[np.minimum(np.searchsorted(keys[order], sought), len(order) - 1)]
    has = keys[found] == sought
    return index[has], found[has]


def succeeded(records: Timed, waiting: NDArray[np.bool_], successors: Timed, frame: int) -> tuple[Timed, NDArray[np.bool_]]:
    """Records whose life ended before `frame`, with trends towards their successors; and which still wait, (K,).

    waiting (K,): which waited so far. successors: of any frames; that of a record is born in the frame after its last. Those whose
    life is over and that have no successor keep their trends.
    """
    over = waiting & (records.last < frame)
    index, found = _matched(np.flatnonzero(over), records, successors)
    frames = (successors.born[found] - records.born[index]).astype(np.float64)
    # gradients of a place that turns are those of its own axes: bring the successor's back to where the record is
    back = records.turn[index] @ successors.turn[found].transpose(0, 2, 1)
    last = successors.records.rows(found)
    last = replace(last, **_turned(last, slice(None), back))
    trends = Trends.between(records.records.rows(index), last, frames)
    return records.with_trends(index, trends), waiting & ~over
