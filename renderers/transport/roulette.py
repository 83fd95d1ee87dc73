"""Levels of forward light cuts of least variance × cost: Russian roulette on the solid angle at which a light is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.transport.cuts import ROULETTE, UNBOUNDED, Family

F64 = NDArray[np.float64]
FAINTEST = 1e-6


@dataclass(frozen=True, eq=False)
class RouletteLevels(Family):
    """Russian roulette on the solid angle: at coordinate a a light survives with probability p(a) ≈ min(1, area/a), and counts 1/p.

    Its level is ν = -log2 u, u uniform in (0, 1], and the same u serves all receivers, so a light acts within one drop. With
    x = a/area

        W(u, a) = φ(u x) x / h(x),    φ(t) = clip(3/2 - t, 0, 1),    h(x) = ∫_0^x φ dt,    hence ∫_0^1 W du = 1.

    φ gives the drop a flank. The contribution W cos θ / r² = W / a is at most 1/area beyond the flank: no light outshines another.
    Derivation: docs/methods/flc.md. area, one or one for each light, is a squared reach; `among` makes it follow brightness.
    """

    area: float | F64
    kernel: ClassVar[int] = ROULETTE

    def among(self, intensities: ArrayLike) -> RouletteLevels:
        """Areas in proportion to the lights' intensities (L, 3), `area` in the mean: where they thin out, all count alike."""
        power = np.asarray(intensities, np.float64).sum(axis=1)
        return RouletteLevels(self.area * np.maximum(power / power.mean(), FAINTEST)) if len(power) else self

    def draw(self, numbers: ArrayLike) -> F64:
        """ν = -log2(1-u)."""
        return np.asarray(-np.log2(1 - np.asarray(numbers, np.float64)))

    def density(self, marks: ArrayLike) -> F64:
        """1: `weight` is W, over the density of ν already."""
        return np.ones(np.shape(marks))

    def weight(self, marks: ArrayLike, areas: ArrayLike) -> F64:
        """W, between 0 and 1/u times 3/2."""
        x = np.asarray(areas, np.float64) / self.area
        kept = np.clip(1.5 - np.exp2(-np.asarray(marks, np.float64)) * x, 0, 1)
        return np.asarray(kept / self._mean_kept(x))

    def bounds(self, marks: ArrayLike) -> tuple[F64, F64]:
        """[0, 3/2 area 2^ν], at most UNBOUNDED."""
        high = np.minimum(1.5 * self.area * np.exp2(np.asarray(marks, np.float64)), UNBOUNDED)
        return np.zeros_like(high), high

    def second_moment(self, areas: ArrayLike) -> F64:
        """∫_0^1 W² du = ∫_0^x φ² dt · x / h(x)²; 5/6 x for x ≥ 3/2, and 1 for x ≤ 1/2."""
        x = np.asarray(areas, np.float64) / self.area
        squares = np.where(x < 0.5, 1.0, (0.5 + (1 - np.clip(1.5 - x, 0, 1) ** 3) / 3) / np.maximum(x, 0.5))
        return np.asarray(squares / self._mean_kept(x) ** 2)

    def _mean_kept(self, x: F64) -> F64:
        """h(x) / x, the probability of surviving."""
        near = np.minimum(x, 1.5)
        return np.where(x < 0.5, 1.0, (near - 0.5 * np.maximum(0, near - 0.5) ** 2) / np.maximum(x, 0.5))

    def _support(self, marks: F64) -> F64:
        rows = np.zeros((10, len(marks)))
        rows[0], rows[1] = np.exp2(-marks), 1 / self.area
        return rows
