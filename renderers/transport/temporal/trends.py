"""How records change in time: temporal gradients of all that they hold.

Radiance records hold coefficients and their translation gradients, which change like irradiance and its gradients do. Between two
records of one place no turn is needed: both live in the axes of the place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Float, Records

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trends:
    """Change per frame of K records: irradiance (K, 3), translation and rotation (K, 3, 3); coefficients (K, n², 3) and
    coefficient_gradients (K, 2, n², 3) of radiance records, None where none of them changes."""

    irradiance: Float
    translation: Float
    rotation: Float
    coefficients: Float | None = None
    coefficient_gradients: Float | None = None

    @staticmethod
    def between(first: Records, last: Records, frames: F64) -> Trends:
        """Of records that become others at the same places over so many frames (K,)."""
        per = 1 / frames
        return _columns(lambda start, end: (end - start) * _beside(per, start), first, last)

    @staticmethod
    def none(count: int) -> Trends:
        """No change."""
        return Trends(np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3, 3)))

    @staticmethod
    def joined(parts: Sequence[Trends]) -> Trends:
        """All of them, in order."""
        if any(part.coefficients is not None for part in parts):
            parts = [part.with_radiance_of(parts) for part in parts]
        return _columns(lambda *columns: np.concatenate(columns), *parts)

    def with_radiance_of(self, others: Sequence[Trends]) -> Trends:
        """The same with coefficients, of zeros where it had none, as one of the others has them."""
        if self.coefficients is not None:
            return self
        columns: Any = {}
        for name in ("coefficients", "coefficient_gradients"):
            like = next(column for other in others if (column := getattr(other, name)) is not None)
            columns[name] = np.zeros((len(self.irradiance), *like.shape[1:]), like.dtype)
        return replace(self, **columns)

    def rows(self, index: Any) -> Trends:
        """Those of the selected records."""
        return _columns(lambda column: column[index], self)

    def after(self, records: Records, frames: Float) -> Records:
        """What records say so many frames (K,) later."""
        later = _columns(lambda change, now: now + change * _beside(frames, change), self, records)
        return replace(records, **{name: column for name in NAMES if (column := getattr(later, name)) is not None})

    def updated(self, index: Any, others: Trends) -> Trends:
        """The same with those of others at the selected records."""
        both = [self, others]
        if any(part.coefficients is not None for part in both):
            both = [part.with_radiance_of(both) for part in both]

        def put(old: Float, new: Float) -> Float:
            old = old.copy()
            old[index] = new
            return old

        return _columns(put, *both)

    def scaled(self, factor: F64) -> Trends:
        """The same times factors (K, 3), a number for each channel."""
        columns: Any = {}
        for name in NAMES:
            column = getattr(self, name)
            if column is not None:
                # channels are the last axis of coefficients, the second of all others
                last = name.startswith("coefficient")
                ones = (1,) * (column.ndim - 2)
                columns[name] = column * factor.reshape(-1, *ones, 3) if last else column * factor.reshape(-1, 3, *ones)
        return Trends(**columns)

    def shrunk(self, factor: F64) -> Trends:
        """The same with all translation gradients times a factor (K,), as limits shorten those of the records."""
        columns: Any = {}
        for name in ("translation", "coefficient_gradients"):
            column = getattr(self, name)
            columns[name] = None if column is None else column * _beside(factor, column)
        return replace(self, **columns)


NAMES = tuple(Trends.__dataclass_fields__)


def _columns(change: Callable[..., Float], *parts: Trends | Records) -> Trends:
    """A change of each column, from those of all parts; None where the first has none."""
    columns: Any = {}
    for name in NAMES:
        values = [getattr(part, name) for part in parts]
        columns[name] = None if values[0] is None else change(*values)
    return Trends(**columns)


def _beside(values: Float, columns: Float) -> Float:
    """Values (K,) that columns (K, …) can be multiplied with, in their type."""
    return np.asarray(values.reshape(-1, *(1,) * (columns.ndim - 1)), columns.dtype)
