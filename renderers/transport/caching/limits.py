"""How large a record's radius is. It starts from one of two measures,

split-sphere   R = harmonic mean distance                                                          Ward 1988
hessian        R = (4 / (π |λ| / E))^¼, λ the largest eigenvalue of the irradiance's Hessian       Schwarzhaupt et al. 2012

the second such that the second-order error, integrated over a zone of radius a·R, is a⁴ times the irradiance whatever the record:
∫ ½ λ r² dA = π λ (aR)⁴ / 4. Then come limits, in this order (Křivánek et al. 2005; Tabellion & Lamorlette 2004):

1  R ← min(R, min_c E_c / |∇_t E_c|)              extrapolation may not double the irradiance over the radius
2  R ← min(R, min_l R_l + |p - p_l|)              neighbour clamping: what a neighbour sees near is near here too
3  R ← clamp(R, R_min, R_max)                     R_min a constant, or larger: so many pixels of the image
4  ∇_tE ← ∇_tE · R_0 / R_min                      where 3 enlarged R from R_0 (before 3) to R_min

Of radiance records, rule 1 takes the norms of all coefficients of a channel and of all their derivatives, times SLACK, and rule 4
scales these. Fine detail of the incoming light changes faster than its mean, and lobes average over it: in a room with a glossy
wall a slack of 4 needs a third of the records of 1 for the same error; without the rule hot spots nearby are extrapolated wildly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Float, Records

Metric = Literal["split-sphere", "hessian"]
NEGLIGIBLE = 1e-6
SLACK = 4.0


@dataclass(frozen=True)
class Footprint:
    """A smallest radius that grows with the distance from the eye (3,): `ratio` times that distance."""

    eye: NDArray[np.float64]
    ratio: float

    def radius(self, position: Float) -> Float:
        """At positions (N, 3): (N,)."""
        return np.asarray(self.ratio * np.linalg.norm(position - self.eye, axis=1))


@dataclass(frozen=True)
class Limits:
    """smallest, largest: R_min and R_max in World units, 0 < R_min ≤ R_max; footprint: R_min is at least that. gradient: rule 1.
    neighbours: rule 2. metric: what R starts from."""

    smallest: float = 0.03
    largest: float = 2.0
    gradient: bool = True
    neighbours: bool = False
    footprint: Footprint | None = None
    metric: Metric = "split-sphere"

    def __post_init__(self) -> None:
        if not 0 < self.smallest <= self.largest < np.inf:
            raise ValueError(f"radii need 0 < smallest <= largest < inf, got {self.smallest} and {self.largest}")

    def lower(self, position: Float) -> Float:
        """R_min at positions (N, 3): (N,)."""
        smallest = np.full(len(position), self.smallest)
        return smallest if self.footprint is None else np.clip(self.footprint.radius(position), self.smallest, self.largest)

    def clamped(self, radius: Float, position: Float) -> Float:
        """Rule 3, (N,) at (N, 3)."""
        return np.asarray(np.clip(radius, self.lower(position), self.largest))


def limited(records: Records, limits: Limits, others: Records | None = None) -> Records:
    """Records with rules 1 to 4 applied. others: records that are there already, whose radii rule 2 respects (as given)."""
    radius = records.radius if limits.metric == "split-sphere" else hessian_radius(records)
    if limits.gradient:
        radius = np.minimum(radius, gradient_limit(records))
    if limits.neighbours:
        positions, radii = records.position, radius
        if others is not None and len(others):
            positions, radii = np.concatenate([positions, others.position]), np.concatenate([radii, others.radius])
        radius = _neighbour_limit(records.position, radius, positions, np.where(np.isinf(radii), limits.largest, radii))
    clamped = limits.clamped(radius, records.position)
    shrink = np.minimum(radius / clamped, 1.0)[:, None, None]
    slopes = records.coefficient_gradients
    return replace(
        records,
        radius=clamped.astype(records.radius.dtype),
        translation=records.translation * shrink,
        coefficient_gradients=None if slopes is None else slopes * shrink[..., None],
    )


def hessian_radius(records: Records) -> NDArray[np.floating[Any]]:
    """R of the Hessian's error bound, (K,): ∞ where irradiance is not curved, the harmonic mean distance where there is none.

    Raises ValueError where records don't know their curvature.
    """
    if records.curvature is None:
        raise ValueError("these records carry no curvature")
    curved = records.curvature > 0
    flat = np.where(records.irradiance.any(axis=1), np.inf, records.radius)  # the dark says nothing about what is around
    return np.asarray(np.where(curved, (4 / (np.pi * np.where(curved, records.curvature, 1))) ** 0.25, flat))


def gradient_limit(records: Records) -> NDArray[np.floating[Any]]:
    """Rule 1, (K,): ∞ where no channel has a gradient worth the name (NEGLIGIBLE of its irradiance per World unit)."""
    bright, steep = records.irradiance, np.linalg.norm(records.translation, axis=2)
    if records.coefficients is not None and records.coefficient_gradients is not None:
        bright = SLACK * np.linalg.norm(records.coefficients, axis=1)
        steep = np.sqrt((records.coefficient_gradients**2).sum(axis=(1, 2)))
    notable = steep > NEGLIGIBLE * bright
    ratio = np.where(notable, bright / np.where(notable, steep, 1), np.inf)
    return np.asarray(ratio.min(axis=1, initial=np.inf))


def neighbour_limit(records: Records) -> NDArray[np.floating[Any]]:
    """Rule 2 among all records at once, (K,)."""
    return _neighbour_limit(records.position, records.radius, records.position, records.radius)


def _neighbour_limit(position: Float, radius: Float, positions: Float, radii: Float) -> NDArray[np.floating[Any]]:
    out = radius.copy()
    _nearest_sum(np.ascontiguousarray(position), out, np.ascontiguousarray(positions), np.ascontiguousarray(radii))
    return out


@numba.njit(parallel=True, cache=True)
def _nearest_sum(position, radius, positions, radii):  # type: ignore[no-untyped-def]
    for k in numba.prange(len(position)):
        smallest = radius[k]
        for other in range(len(positions)):
            if radii[other] < smallest:
                square = 0.0
                for c in range(3):
                    square += (position[k, c] - positions[other, c]) ** 2
                smallest = min(smallest, radii[other] + np.sqrt(square))
        radius[k] = smallest
