"""Forward light cuts: each virtual light draws a level, independent of all others; the level says where it acts and how strongly.

    α_y(x) = ε_Ω |x-y|³ / ⟨n_y, x-y⟩                 coordinate of a receiver; its level sets are drops standing on y       (4.13)
    Σ_k s_k(a) = 1 for every a                        partition of unity, so E[s_κ(α)/μ_κ] = 1 and the sum stays unbiased   (4.16)
    ∫ s̃(ν, a) dν = 1                                  the same for a continuous level ν of density μ̃                        (4.41)

All of Laurent 2018, chapter 4. Only a/ε_Ω counts, a squared reach: areas may be given in any unit that α is measured in. The
methods use ε_Ω = 1, so that the area of a level is the square of the distance it reaches along the normal.

| class            | level               | support functions                                     | source          |
| ---------------- | ------------------- | ----------------------------------------------------- | --------------- |
| `DiscreteLevels` | κ = 1 … K           | C⁰ hats, or C⁻¹ steps between the middles of the areas | (4.18), (4.17)  |
| `LinearLevels`   | ν in [0, K+1]       | the hats, interpolated linearly in ν                  | (4.45)          |
| `RidgeLevels`    | ν ≥ 0, exponential  | a triangle around λ_D ln(1 + a/a_⋆)                    | (4.46) … (4.48) |
| `RouletteLevels` | ν ≥ 0, exponential  | all a up to that of ν: least variance × cost          | `roulette`      |

The last discrete level is unbounded, and so are the linear ones above K-1: bounding them would lose all far light.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import factorial
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
UNBOUNDED = 1e20
STEEP = 1e24
PARAMETERS = 12
HAT, TWO_HATS, RIDGE, ROULETTE = 0, 1, 2, 3

# Smallest sphere around the drop r = R √cos θ: its centre lies DROP_HEIGHT·R along the normal, its radius is DROP_WIDTH·R, which is
# the drop's largest half-width, reached at that height.
DROP_HEIGHT = 27**-0.25
DROP_WIDTH = (2 / 27**0.5) ** 0.5


class Family(ABC):
    """A law of levels and its support functions. `marks` are levels: κ as float (1 … K), or ν; float64, any shape."""

    kernel: ClassVar[int]

    @abstractmethod
    def draw(self, numbers: ArrayLike) -> F64:
        """Levels of uniform numbers in [0, 1)."""

    @abstractmethod
    def density(self, marks: ArrayLike) -> F64:
        """Probability μ_κ, or density μ̃(ν)."""

    @abstractmethod
    def weight(self, marks: ArrayLike, areas: ArrayLike) -> F64:
        """s_κ(a) or s̃(ν, a), ≥ 0, at coordinates a ≥ 0; broadcast."""

    @abstractmethod
    def bounds(self, marks: ArrayLike) -> tuple[F64, F64]:
        """Interval of coordinates outside which the weight is 0; its end is UNBOUNDED where there is none."""

    @abstractmethod
    def second_moment(self, areas: ArrayLike) -> F64:
        """E[(s/μ)²] at coordinates a: the factor on the variance of one light that the draw of levels brings."""

    def among(self, intensities: ArrayLike) -> Family:
        """The law for lights of these intensities (L, 3): the same for all, where a family doesn't say otherwise."""
        return self

    @abstractmethod
    def _support(self, marks: F64) -> F64:
        """What the kernels need to evaluate the weight, (10, n)."""

    def parameters(self, marks: F64) -> F32:
        """Rows for the splatting kernels, float32 (PARAMETERS, n): bounds, then the support's shape (see `splat_kernels`)."""
        return np.concatenate([np.stack(self.bounds(marks)), self._support(marks)]).astype(np.float32)


@dataclass(frozen=True, eq=False)
class DiscreteLevels(Family):
    """K levels of areas a_1 < … < a_K and probabilities μ_1 … μ_K. smooth: C⁰ hats (4.18), else C⁻¹ steps (4.17)."""

    areas: F64
    shares: F64
    smooth: bool = True
    kernel: ClassVar[int] = HAT

    def draw(self, numbers: ArrayLike) -> F64:
        """Smallest k with u < μ_1 + … + μ_k (4.27; the thesis prints "not satisfying", which never returns levels above 1)."""
        steps = np.cumsum(self.shares)
        return np.asarray(1 + np.minimum(np.searchsorted(steps, numbers, side="right"), len(steps) - 1), np.float64)

    def density(self, marks: ArrayLike) -> F64:
        """μ_κ."""
        return np.asarray(self.shares[np.asarray(marks, np.int64) - 1])

    def weight(self, marks: ArrayLike, areas: ArrayLike) -> F64:
        """(4.18), or (4.17)."""
        a = np.asarray(areas, np.float64)
        if not self.smooth:
            low, high = self.bounds(marks)
            return np.where((a >= low) & (a < high), 1.0, 0.0)
        return _hat(_shape(self.areas, marks), a)

    def bounds(self, marks: ArrayLike) -> tuple[F64, F64]:
        """(a_{k-1}, a_{k+1}), or between the middles of neighbouring areas; [0, … for k = 1 and … ∞) for k = K."""
        k = np.asarray(marks, np.int64)
        knots = self.areas if self.smooth else (self.areas[1:] + self.areas[:-1]) / 2
        padded = np.concatenate([[0.0, 0.0], knots, [UNBOUNDED, UNBOUNDED]])
        return padded[k], padded[k + 2 if self.smooth else k + 1]

    def second_moment(self, areas: ArrayLike) -> F64:
        """Σ s_k(a)² / μ_k."""
        levels = np.arange(1.0, len(self.areas) + 1)
        weights = self.weight(levels, np.asarray(areas, np.float64)[..., None])
        return np.asarray((weights**2 / self.shares).sum(axis=-1))

    def _support(self, marks: F64) -> F64:
        if self.smooth:
            return _two(_shape(self.areas, marks), None, np.ones(len(marks)), np.zeros(len(marks)))
        low, high = self.bounds(marks)
        # Flanks steeper than float32 resolves. The step at `low` is closed: a coordinate there belongs to the level above.
        low = np.where(low > 0, np.nextafter(low.astype(np.float32), np.float32(-1)), -1.0)
        steps = np.stack([low, np.full(len(low), STEEP), high, np.where(high < UNBOUNDED, STEEP, 1.0)])
        return _two(steps, None, np.ones(len(low)), np.zeros(len(low)))


@dataclass(frozen=True, eq=False)
class LinearLevels(Family):
    """Σ_k s_k(a) Λ(ν-k), Λ the unit tent, ν in [0, K+1] of density ∝ exp(-rate·ν) (4.45).

    The thesis keeps the whole exponential; cutting it at K+1 wastes no draws. Over the printed range ]0, K[ the integral would fall
    to ½ for large a.
    """

    areas: F64
    rate: float
    kernel: ClassVar[int] = TWO_HATS

    @property
    def _mass(self) -> float:
        return float(-np.expm1(-self.rate * (len(self.areas) + 1)))

    def draw(self, numbers: ArrayLike) -> F64:
        """Inversion of the truncated exponential law."""
        return np.asarray(-np.log1p(-np.asarray(numbers, np.float64) * self._mass) / self.rate)

    def density(self, marks: ArrayLike) -> F64:
        """rate · exp(-rate·ν) / (1 - exp(-rate·(K+1)))."""
        return np.asarray(self.rate * np.exp(-self.rate * np.asarray(marks, np.float64)) / self._mass)

    def weight(self, marks: ArrayLike, areas: ArrayLike) -> F64:
        """(4.45)."""
        nu, a = np.asarray(marks, np.float64), np.asarray(areas, np.float64)
        k = np.floor(nu)
        t = nu - k
        return np.asarray((1 - t) * self._level(k, a) + t * self._level(k + 1, a))

    def bounds(self, marks: ArrayLike) -> tuple[F64, F64]:
        """Union of the supports of levels ⌊ν⌋ and ⌊ν⌋+1, those of 1 … K."""
        k = np.floor(np.asarray(marks, np.float64)).astype(np.int64)
        padded = np.concatenate([[0.0, 0.0], self.areas, [UNBOUNDED, UNBOUNDED, UNBOUNDED]])
        return padded[k], padded[k + 3]

    def second_moment(self, areas: ArrayLike) -> F64:
        """∫ s̃² / μ̃ dν, by 64-point Gauss-Legendre quadrature on each unit interval, where the integrand is smooth."""
        a = np.asarray(areas, np.float64)[..., None]
        x, w = np.polynomial.legendre.leggauss(64)
        total = np.zeros(a.shape[:-1])
        for k in range(len(self.areas) + 1):
            nu = k + (x + 1) / 2
            total += (self.weight(nu, a) ** 2 / self.density(nu) * w / 2).sum(axis=-1)
        return total

    def _level(self, k: F64, a: F64) -> F64:
        inside = (k >= 1) & (k <= len(self.areas))
        return np.where(inside, _hat(_shape(self.areas, np.clip(k, 1, len(self.areas))), a), 0.0)

    def _support(self, marks: F64) -> F64:
        k, last = np.floor(marks), len(self.areas)
        t = marks - k
        first, second = _shape(self.areas, np.clip(k, 1, last)), _shape(self.areas, np.clip(k + 1, 1, last))
        return _two(first, second, np.where(k >= 1, 1 - t, 0.0), np.where(k + 1 <= last, t, 0.0))


@dataclass(frozen=True, eq=False)
class RidgeLevels(Family):
    """ν ≥ 0 of density rate · exp(-rate·ν), acting where ν_mid(a) = ridge · ln(1 + a/area) lies within 1 of ν (4.46 … 4.48).

    rate is λ_L, ridge λ_D, area a_⋆. With rate · ridge ≤ 1 the largest contribution of one light is bounded in ν; above 4/3 the
    variance under an endless wall is infinite.
    """

    rate: float
    ridge: float
    area: float
    kernel: ClassVar[int] = RIDGE

    def draw(self, numbers: ArrayLike) -> F64:
        """ν = -ln(1-u) / λ_L (4.44)."""
        return np.asarray(-np.log1p(-np.asarray(numbers, np.float64)) / self.rate)

    def density(self, marks: ArrayLike) -> F64:
        """λ_L exp(-λ_L ν) (4.42)."""
        return np.asarray(self.rate * np.exp(-self.rate * np.asarray(marks, np.float64)))

    def weight(self, marks: ArrayLike, areas: ArrayLike) -> F64:
        """(4.47), between 0 and 2."""
        nu, mid = np.asarray(marks, np.float64), self.middle(areas)
        low = np.maximum(0.0, mid - 1)
        rising = (np.minimum(nu, mid) - low) / np.where(mid > low, mid - low, 1.0)
        height = np.where(nu < mid, rising, mid + 1 - nu)
        return np.asarray(np.maximum(0.0, height) / np.minimum(1.0, (mid + 1) / 2))

    def bounds(self, marks: ArrayLike) -> tuple[F64, F64]:
        """a_⋆ [max(0, e^((ν-1)/λ_D) - 1), e^((ν+1)/λ_D) - 1], at most UNBOUNDED."""
        nu = np.asarray(marks, np.float64)
        longest = np.log(UNBOUNDED)
        low = self.area * np.expm1(np.minimum(np.maximum(nu - 1, 0) / self.ridge, longest))
        return np.minimum(low, UNBOUNDED), np.minimum(self.area * np.expm1(np.minimum((nu + 1) / self.ridge, longest)), UNBOUNDED)

    def second_moment(self, areas: ArrayLike) -> F64:
        """∫ s̃² / μ̃ dν in closed form: with λ = λ_L and m = ν_mid,

        m ≥ 1: 4 (sinh λ - λ) / λ⁴ · e^(λm);   m < 1: 4/(m+1)² [2 e^(λm) (e^λ - 1 - λ - λ²/2) / λ⁴ + ∫_0^m t² e^(λt) dt / (λ m²)].
        """
        rate, m = self.rate, self.middle(areas)
        x = rate * m
        far = 4 * (np.sinh(rate) - rate) / rate**4 * np.exp(x)
        # ∫_0^m t² e^(λt) dt / (λ m²) = m g(λm) / λ with g(x) = (e^x (x² - 2x + 2) - 2) / x³, whose series serves small x
        safe = np.where(x > 0.1, x, 1.0)
        closed = (np.exp(safe) * (safe * safe - 2 * safe + 2) - 2) / safe**3
        series = np.sum([x**n / (factorial(n) * (n + 3)) for n in range(12)], axis=0)
        rise = m / rate * np.where(x > 0.1, closed, series)
        near: F64 = 4 / (m + 1) ** 2 * (2 * np.exp(x) * (np.expm1(rate) - rate - rate**2 / 2) / rate**4 + rise)
        return np.asarray(np.where(m >= 1, far, near))

    def middle(self, areas: ArrayLike) -> F64:
        """ν_mid(a) = λ_D ln(1 + a/a_⋆) (4.46)."""
        return np.asarray(self.ridge * np.log1p(np.asarray(areas, np.float64) / self.area))

    def _support(self, marks: F64) -> F64:
        rows = np.zeros((10, len(marks)))
        rows[0], rows[1], rows[2] = marks, self.ridge, 1 / self.area
        return rows


def geometric_levels(count: int, area: float, area_ratio: float, share_ratio: float) -> tuple[F64, F64]:
    """Areas a_k = a_1 q_a^(k-1) (4.28) and probabilities μ_k ∝ q_N^-(k-1), of sum 1 (4.19): float64 (K,) each.

    Raises ValueError unless count ≥ 1, area > 0 and both ratios > 1.
    """
    if count < 1 or not area > 0 or not min(area_ratio, share_ratio) > 1:
        raise ValueError(f"levels need count ≥ 1, area > 0 and ratios > 1, got {count}, {area}, {area_ratio}, {share_ratio}")
    k = np.arange(count, dtype=np.float64)
    shares = share_ratio**-k
    return area * area_ratio**k, shares / shares.sum()


def coordinate(receivers: ArrayLike, lights: ArrayLike, normals: ArrayLike, threshold: float = 1.0) -> F64:
    """α_y(x) = ε_Ω |x-y|³ / ⟨n_y, x-y⟩ (4.13), float64; infinite behind the light. (…, 3) each; threshold: ε_Ω in sr."""
    v = np.asarray(receivers, np.float64) - np.asarray(lights, np.float64)
    c = np.einsum("...i,...i", v, np.asarray(normals, np.float64))
    cube = np.linalg.norm(v, axis=-1) ** 3
    return np.where(c > 0, threshold * cube / np.where(c > 0, c, 1.0), np.inf)


def enclosing_spheres(lights: F64, normals: F64, outer: F64) -> tuple[F64, F64]:
    """Centres (n, 3) and radii (n,) of the smallest spheres around {α < outer}; outer (n,): squared reaches (areas for ε_Ω = 1)."""
    reach = np.sqrt(outer)
    return lights + (DROP_HEIGHT * reach)[:, None] * normals, DROP_WIDTH * reach


def _shape(areas: F64, marks: ArrayLike) -> F64:
    """low, rise, high, fall of C⁰ levels: s(a) = clip(min((a - low) · rise, (high - a) · fall), 0, 1); (4, …)."""
    k = np.asarray(marks, np.int64)
    last = len(areas)
    padded = np.concatenate([[0.0], areas, [UNBOUNDED]])
    low, peak, high = padded[k - 1], padded[k], padded[k + 1]
    first, final = k == 1, k == last
    rise = np.where(first, STEEP, 1 / np.where(first, 1.0, peak - low))
    fall = np.where(final, 1.0, 1 / np.where(final, 1.0, high - peak))
    return np.stack([np.where(first, -1.0, low), rise, high, fall])


def _hat(shape: F64, a: F64) -> F64:
    low, rise, high, fall = shape
    return np.asarray(np.clip(np.minimum((a - low) * rise, (high - a) * fall), 0.0, 1.0))


def _two(first: F64, second: F64 | None, share: F64, rest: F64) -> F64:
    """Two hats and their shares as kernel rows, (10, n)."""
    return np.concatenate([first, np.zeros_like(first) if second is None else second, share[None], rest[None]])
