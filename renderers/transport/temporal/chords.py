"""Longer lives for records that are interpolated in time: as long as the chord to their successor holds. Not in the publication.

Between a record and its successor the value goes along a chord, which is off by |E''| L²/8 in the middle of L frames, however fast
the light changes. E'' is known where a place has had records before, from divided differences through its last ones and the frame
foreseen; the greatest counts:

    life = max(life by the rate of change, min(δ_max, 2 L_before, ⌊√(8 · CHORD a_t E_k / |E''|)⌋))

as step sizes are chosen in solvers of differential equations, from the error that the steps before have made. Of radiance records E
is the vector of all coefficients, and sizes are norms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Records
from renderers.transport.temporal.lifespan import TIE
from renderers.transport.temporal.records import Timed

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Size = Callable[[F64], F64]
CHORD = 0.25  # of a_t: with a half, errors under a moving light rise by a tenth


def light_of(records: Records) -> F64:
    """What a record's life depends on, (K, n): its coefficients, or its irradiance where it has none."""
    light = records.irradiance if records.coefficients is None else records.coefficients.reshape(len(records), -1)
    return np.asarray(light, np.float64)


def brightest(light: F64) -> F64:
    """Size of irradiances (K, 3): that of the channel where it is greatest, (K,)."""
    return np.asarray(np.abs(light).max(axis=1))


def norm(light: F64) -> F64:
    """Size of coefficients (K, n): that of the function, whose basis is orthonormal, (K,)."""
    return np.asarray(np.linalg.norm(light, axis=1))


def curvature(
    earlier: F64, span: I64, slope: F64, frames: I64, ahead: F64, foreseen: NDArray[np.bool_], size: Size = brightest
) -> F64:
    """Size of the greatest second derivative per frame², (K,), ∞ where it is unknown.

    Light changed by `earlier` (K, n) a frame over `span` (K,) frames, then by `slope` (K, n) a frame over `frames` (K,) ≥ 1 frames,
    and will, where `foreseen` (K,), change by `ahead` (K, n) in the next one. span 0: nothing earlier is known; span -1: `earlier`
    is the change from the first of `frames` to the second, a stretch that leads back in time.
    """
    known = (span != 0) & (span + frames != 0)
    width = np.where(known, span + frames, 1)
    past = np.where(known, 2 * size(slope - earlier) / np.abs(width), 0)
    coming = np.where(foreseen, 2 * size(ahead - slope) / (frames + 1), 0)
    return np.asarray(np.where(known | foreseen, np.maximum(past, coming), np.inf))


def chord_lifespan(bend: F64, error: float, longest: int) -> I64:
    """Frames (K,), at least 1, through which chords of light with second derivative `bend` (K,) ≥ 0, relative to the light, are off
    by at most `error`."""
    curved = bend > 0
    frames = np.where(curved, np.sqrt(8 * error / np.where(curved, bend, 1)) * (1 + TIE), np.inf)
    return np.asarray(np.clip(np.floor(np.minimum(frames, longest)), 1, longest), np.int64)


def first_of_a_place(new: Timed, now: Records, later: Records, foreseen: NDArray[np.bool_]) -> Timed:
    """First records with what is foreseen of their light noted: the next record at their place will look back at it."""
    return replace(new, slope=light_of(later) - light_of(now), span=np.where(foreseen, -1, 0))


def lengthened(
    new: Timed, old: Timed, now: Records, later: Records, foreseen: NDArray[np.bool_], least: float, a_t: float, longest: int
) -> Timed:
    """Successors of old records, (K,) each, with lives by the rate, living as long as chords hold where that is longer.

    now, later: them before limits, and one frame later where `foreseen` (K,). least: as in `lifespan`.
    """
    size = brightest if now.coefficients is None else norm
    light, frames = light_of(now), new.born - old.born
    slope = (light - light_of(old.records)) / frames[:, None]
    bend = curvature(old.slope, old.span, slope, frames, light_of(later) - light, foreseen, size) / np.maximum(size(light), least)
    life = np.maximum(new.life, np.minimum(chord_lifespan(bend, CHORD * a_t, longest), 2 * frames))
    rest = life == 1
    return replace(new, life=life, strikes=new.strikes * rest, rest=new.rest * rest, slope=slope, span=frames)
