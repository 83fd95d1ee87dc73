"""Records: what is kept of the light at a few places, as a structure of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Float = NDArray[np.floating[Any]]


class Sites(NamedTuple):
    """Surface points. position, normal (shading, unit, turned to the viewer), geometric (unit, either side): float64 (N, 3)."""

    position: F64
    normal: F64
    geometric: F64

    def rows(self, index: Any) -> Sites:
        """The selected points."""
        return Sites(*(column[index] for column in self))


class Columns(NamedTuple):
    """The arrays of irradiance records, as kernels read them (see `Records`)."""

    position: Float
    normal: Float
    radius: Float
    irradiance: Float
    translation: Float
    rotation: Float


@dataclass(frozen=True, eq=False)
class Records:
    """K records, all arrays of one float type, in World units.

    position, normal (K, 3). radius (K,): R, the harmonic mean distance after the limits; a record reaches a·R far at accuracy a.
    irradiance (K, 3), one value a channel. translation, rotation (K, 3, 3): its gradients [channel, component] in world axes,
    absolute, per World unit and per radian; the argument of the latter is n_k × n. coefficients (K, n², 3): incoming radiance in
    hemispherical harmonics of the frame (tangents, normal), where records carry it, and coefficient_gradients (K, 2, n², 3) its
    derivatives along the two tangents (K, 2, 3), which are `sampling.frame(normal)` where they aren't given. curvature,
    clearance (K,): see `gradients.Moments`, where the sampler knows them.
    """

    position: Float
    normal: Float
    radius: Float
    irradiance: Float
    translation: Float
    rotation: Float
    coefficients: Float | None = None
    coefficient_gradients: Float | None = None
    curvature: Float | None = None
    clearance: Float | None = None
    tangents: Float | None = None

    def __len__(self) -> int:
        return len(self.position)

    def rows(self, index: Any) -> Records:
        """The selected records."""
        return self._mapped(lambda column: column[index])

    def astype(self, dtype: Any) -> Records:
        """The same in another float type, C-contiguous."""
        return self._mapped(lambda column: np.ascontiguousarray(column, dtype))

    def columns(self, dtype: Any) -> Columns:
        """What irradiance is interpolated from, in one float type, C-contiguous."""
        return Columns(*(np.ascontiguousarray(getattr(self, name), dtype) for name in Columns._fields))

    def with_radius(self, radius: Float) -> Records:
        """The same with other radii."""
        return replace(self, radius=radius.astype(self.radius.dtype))

    @staticmethod
    def empty(dtype: Any = np.float64) -> Records:
        """No records."""
        three = np.zeros((0, 3), dtype)
        return Records(three, three, np.zeros(0, dtype), three, np.zeros((0, 3, 3), dtype), np.zeros((0, 3, 3), dtype))

    @staticmethod
    def joined(parts: Sequence[Records]) -> Records:
        """All records of all parts, in order. Raises ValueError when only some carry coefficients."""
        filled = [part for part in parts if len(part)]
        if not filled:
            return parts[0] if parts else Records.empty()
        columns: Any = {}
        for name in (field.name for field in fields(Records)):
            values = [getattr(part, name) for part in filled]
            missing = [value is None for value in values]
            if any(missing) and not all(missing):
                raise ValueError(f"only some of the records have {name}")
            columns[name] = None if all(missing) else np.concatenate(values)
        return Records(**columns)

    def _mapped(self, change: Any) -> Records:
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        mapped: Any = {name: None if value is None else change(value) for name, value in columns.items()}
        return Records(**mapped)
