"""The specification's toy: a bumpy floor lit by two rectangles of exactly known irradiance, one of them moving.

Floor points z = 0, normals ∝ (-¼ sin 5x, -¼ cos 4y, 1). Rectangles face down: one at rest at (0, 0, 2), half sides 0.5, radiance
3; one at (0.75 sin 0.05vt, 0.5 cos 0.05vt, 0.9 + 0.1 sin 0.09vt), half sides 0.25 and 0.2, radiance 4. Distances are those to a
box of 5 × 5 × 2 and to the moving rectangle. Vector irradiance V is exact, hence E = n·V, ∇_r = n × V, and ∇_p by central
differences.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.transport.caching.limits import Limits
from renderers.transport.caching.placement import Order, Placement
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.temporal import cache as temporal_cache
from renderers.transport.temporal.cache import Policy, Stage, TemporalCache, View
from renderers.transport.temporal.records import Timed, succeeded

F64 = NDArray[np.float64]
SIDE = 40
STEP = 1e-4
DIRECTIONS = 400


def normals(position: F64) -> F64:
    """Unit normals (N, 3) of floor points (N, 3)."""
    x, y = position[:, 0], position[:, 1]
    n = np.stack([-0.25 * np.sin(5 * x), -0.25 * np.cos(4 * y), np.ones_like(x)], axis=1)
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


@dataclass(frozen=True)
class Lamps:
    """The two rectangles at time t, in frames, at speed v."""

    t: float
    v: float

    @property
    def centre(self) -> F64:
        """Of the moving one."""
        s = self.v * self.t
        return np.array([0.75 * np.sin(0.05 * s), 0.5 * np.cos(0.05 * s), 0.9 + 0.1 * np.sin(0.09 * s)])

    def vector(self, position: F64) -> F64:
        """V (N, 3) at points (N, 3)."""
        out = np.zeros_like(position)
        for centre, (a, b), radiance in ((np.array([0.0, 0, 2]), (0.5, 0.5), 3.0), (self.centre, (0.25, 0.2), 4.0)):
            corners = centre + np.array([(-a, -b, 0), (-a, b, 0), (a, b, 0), (a, -b, 0)])
            ray = corners - position[:, None]
            ray /= np.linalg.norm(ray, axis=2, keepdims=True)
            after = np.roll(ray, -1, axis=1)
            cross = np.cross(ray, after)
            length = np.linalg.norm(cross, axis=2, keepdims=True)
            angle = np.arctan2(length, (ray * after).sum(axis=2, keepdims=True))
            part = radiance / 2 * (angle * cross / length).sum(axis=1)
            out += part * np.sign(part[:, 2:])
        return out

    def irradiance(self, position: F64, normal: F64) -> F64:
        """E (N,)."""
        return np.asarray(np.einsum("nc,nc->n", normal, self.vector(position)))

    def records(self, sites: Sites) -> Records:
        """Exact records, one value for all channels."""
        n, count = sites.normal, len(sites.position)
        vector = self.vector(sites.position)
        moved = [
            (self.irradiance(sites.position + h, n) - self.irradiance(sites.position - h, n)) / (2 * STEP)
            for h in np.eye(3)[:2] * STEP
        ]
        translation = np.stack([*moved, np.zeros(count)], axis=1)
        three = np.ones((1, 3))
        irradiance = np.einsum("nc,nc->n", n, vector)[:, None] * three
        gradients = (np.repeat(g[:, None], 3, axis=1) for g in (translation, np.cross(n, vector)))
        return Records(sites.position, n, self.distances(sites), irradiance, *gradients)

    def distances(self, sites: Sites) -> F64:
        """Harmonic mean distances (N,) over directions spread evenly over the upper hemisphere."""
        k = np.arange(DIRECTIONS)
        z = (k + 0.5) / DIRECTIONS
        phi = k * np.pi * (3 - np.sqrt(5))
        d = np.stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z], axis=1)
        p = sites.position[:, None]
        with np.errstate(divide="ignore"):
            walls = np.where(d > 0, (np.array([2.5, 2.5, 2.0]) - p) / d, (np.array([-2.5, -2.5, 0.0]) - p) / d)
        reach = np.where(d == 0, np.inf, walls).min(axis=2)
        along = (self.centre[2] - p[..., 2]) / d[:, 2]
        at = p + along[..., None] * d - self.centre
        hits = (np.abs(at[..., 0]) <= 0.25) & (np.abs(at[..., 1]) <= 0.2)
        return np.asarray(1 / np.mean(1 / np.where(hits, np.minimum(along, reach), reach), axis=1))


@dataclass(frozen=True)
class Film:
    """What a run gave: images and the truth (N, P), counters of each frame, and the records of each frame with their trends."""

    images: F64
    truth: F64
    counters: list[Counter[str]]
    records: list[Timed]

    def total(self, name: str) -> int:
        """A counter, over all frames."""
        return sum(c[name] for c in self.counters)

    @property
    def error(self) -> F64:
        """(N, P), over the mean of the truth."""
        return np.asarray((self.images - self.truth) / self.truth.mean())

    @property
    def rmse(self) -> float:
        """Over all frames."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def flicker(self) -> float:
        """RMS change of the error from frame to frame."""
        return float(np.sqrt(np.mean(np.diff(self.error, axis=0) ** 2)))

    @property
    def accuracy(self) -> F64:
        """Percent, of each frame."""
        floor = np.maximum(self.truth, 1e-3 * self.truth.mean())
        return np.asarray(100 * (1 - np.mean(np.abs(self.images - self.truth) / floor, axis=1)))


def hold_places(
    monkeypatch: pytest.MonkeyPatch, held: Callable[[F64], Any] = lambda position: np.ones(len(position), bool)
) -> None:
    """Say which places (N, 3) lie on a surface, (N,), where there is no scene: all of them."""
    monkeypatch.setattr(temporal_cache, "anchors", lambda world, sites: SimpleNamespace(held=held(sites.position)))


def run(
    monkeypatch: pytest.MonkeyPatch,
    mode: str,
    frames: int = 60,
    v: float = 0.25,
    pan: float = 0.0,
    a: float = 0.2,
    order: Order = "batched",
    **policy: Any,
) -> Film:
    """So many frames, and as many more as their records live. pan: floor units a frame that the view moves by."""
    hold_places(monkeypatch)
    chosen = Policy(**{"guard": False, "stagger": False, "frozen": mode == "none", **policy})
    cache, films, open_ = TemporalCache(chosen), [], []
    canvases, truth, counters = [], [], []
    placement = Placement(a, limits=Limits(1e-3, 1e3, gradient=False), order=order)
    for t in range(frames + (chosen.longest if mode == "interpolated" else 0)):
        canvas = _view(t * pan)
        counter = Counter[str]()
        stage = _stage(t, v, placement, counter)
        sites = Sites(canvas.position, canvas.normal, np.broadcast_to([0.0, 0, 1], canvas.normal.shape))
        renewed = cache.step(stage, [View(canvas, sites)], counter)
        for k, (film, waits) in enumerate(zip(films, open_, strict=True)):
            films[k], open_[k] = succeeded(film, waits, renewed, t)
        if t < frames:
            films.append(cache.live)
            open_.append((cache.live.life > 1) & (mode == "interpolated"))
            canvases.append(canvas)
            truth.append(Lamps(t, v).irradiance(canvas.position, canvas.normal))
            counters.append(counter)
    images = []
    for t, (canvas, film) in enumerate(zip(canvases, films, strict=True)):
        canvas.clear()
        canvas.add(film.at(t), a)
        images.append(canvas.irradiance[:, 0])
    return Film(np.array(images), np.array(truth), counters, films)


def _view(shift: float) -> Canvas:
    x = -1 + 2 * (np.arange(SIDE) + 0.5) / SIDE
    grid = np.stack(np.meshgrid(x + shift, x), axis=-1).reshape(-1, 2)
    position = np.concatenate([grid, np.zeros((len(grid), 1))], axis=1)
    return Canvas(np.arange(len(grid)), SIDE, position, normals(position), np.float64)


def _stage(t: int, v: float, placement: Placement, counter: Counter[str]) -> Stage:
    now, later = Lamps(t, v), Lamps(t + 1, v)

    def sample(sites: Sites, places: Any, ahead: Any, tangents: Any = None) -> tuple[Records, Records]:
        counter["records"] += len(sites.position)
        found = now.records(sites)
        return found, found if ahead is None else later.records(sites)

    sampler: Any = SimpleNamespace(sample=sample, distances=now.distances, world=None)
    ahead: Any = object()
    return Stage(t, sampler, sampler, ahead, placement, False, t)
