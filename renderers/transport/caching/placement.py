"""Where records are put: wherever a pixel is reached by none ("cache miss"), until all are reached or a limit is.

batched     Misses are found for the whole image, thinned, and all records of a round are computed together. Thinning walks the
            misses in an order drawn at random, with each one's harmonic mean distance known from a few rays: it accepts one and
            passes over those inside its zone, as dart throwing does, which spreads the accepted ones like blue noise. Few rounds
            are needed, since only pixels where the zone turned out smaller than foreseen are left. No few rays tell the radius of
            the `hessian` metric: there each round foresees a common radius, 1/√2 of the one before.
sequential  One record at a time, at the first miss in the order of the pixels (Gautron 2006, algorithm 4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.limits import Limits, limited
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.sight import Blocked, in_sight
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.weights import Weight
from renderers.transport.sampling import generator

Order = Literal["batched", "sequential"]
FIRST_SHARE, GROWTH = 1 / 1024, 4
DESCENT = 2**-0.5
UNLIMITED = 1 << 62


class Compute(Protocol):
    """Makes records of places; `first` is the number of the first."""

    def __call__(self, sites: Sites, first: int = 0) -> Records: ...


@dataclass(frozen=True)
class Placement:
    """How records are placed and used: accuracy a, weight, use of gradients, limits, order, seed of the random order; sees: zones
    end at what is hidden from their records (`sight`)."""

    a: float = 0.15
    weight: Weight = "ward"
    gradients: bool = True
    limits: Limits = field(default_factory=Limits)
    order: Order = "batched"
    seed: int = 0
    sees: bool = False


def fill(
    canvas: Canvas,
    sites: Sites,
    compute: Compute,
    distances: Callable[[Sites], NDArray[np.float64]],
    placement: Placement,
    records: Records | None = None,
    most: int | None = None,
    blocked: Blocked | None = None,
) -> Records:
    """Old and new records, in order, after adding the new ones to a canvas (which must hold the old ones already).

    sites: of the canvas's pixels. distances: a quick estimate of the harmonic mean distance (`PolarSampler.distances`). most: at
    most so many new records; some pixels may then stay without. blocked: what is hidden from new records
    (`RayCaster.occluded`), for placements that see.
    """
    records = Records.empty() if records is None else records
    left, rounds = UNLIMITED if most is None else most, 0
    while left > 0:
        chosen = _chosen(canvas, sites, distances, placement, left, len(records), rounds)
        left, rounds = left - len(chosen), rounds + 1
        if len(chosen):
            new = limited(compute(sites.rows(chosen), len(records)), placement.limits, records)
            if placement.sees and blocked is not None:
                new = in_sight(new, canvas, placement.a, placement.weight, blocked)
            canvas.add(new, placement.a, placement.weight, placement.gradients)
            records = Records.joined([records, new])
        elif not canvas.missed.any():
            break
    return records


def _chosen(
    canvas: Canvas,
    sites: Sites,
    distances: Callable[[Sites], NDArray[np.float64]],
    placement: Placement,
    most: int,
    placed: int,
    rounds: int,
) -> NDArray[np.int64]:
    """Pixels for the records of one round."""
    if placement.order == "sequential":
        return np.flatnonzero(canvas.missed)[:1]
    if placement.limits.metric == "split-sphere":
        return _batch(canvas, sites, distances, placement, most, placed)
    common = placement.limits.largest * DESCENT**rounds
    return _batch(canvas, sites, lambda part: np.full(len(part.position), common), placement, most, placed)


def _batch(
    canvas: Canvas, sites: Sites, distances: Callable[[Sites], NDArray[np.float64]], placement: Placement, most: int, placed: int
) -> NDArray[np.int64]:
    """Misses, thinned. Estimates are made for growing parts of the misses, and only where still needed."""
    covered = ~canvas.missed
    misses = generator(placement.seed, f"misses after {placed}").permutation(np.flatnonzero(~covered))
    chosen: list[NDArray[np.int64]] = []
    start, size = 0, max(16, int(len(misses) * FIRST_SHARE))
    while start < len(misses) and most > 0:
        part = misses[start : start + size]
        part = part[~covered[part]]
        if len(part):
            radius = placement.limits.clamped(distances(sites.rows(part)), sites.position[part])
            chosen.append(canvas.thinned(part, radius, placement.a, placement.weight, covered, most))
            most -= len(chosen[-1])
        start, size = start + size, size * GROWTH
    return np.concatenate(chosen) if chosen else np.zeros(0, np.int64)
