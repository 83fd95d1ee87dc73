"""The live records of an animation, from frame to frame.

1  A record whose life is over is computed anew at exactly its place: places are constants of the world, so the pattern of
   interpolation errors stands still. It is deleted where it reached no pixel in its last frame, and (not in the publication)
   where no surface lies any more, as behind or within an object that moved.
2  All valid records are splatted; pixels that none reaches get new ones, as in `caching.placement`.
3  Every record computed gets a lifespan from its change rate to the next frame (`lifespan`).             Gautron 2006, section 5.4

Nothing is computed where nothing can have changed: while the Worlds of all frames since its own and the next one are alike, a
record at the end of its life serves another one as it is.

Guard (`Policy.guard`): foreseeing costs, and pays only where lives get longer than a frame. A place whose foreseen record lives
for one frame is computed without foresight for 1, 3, 7 … 15 frames after it, with life 1; new places likewise, once most places
do. So where light changes everywhere a frame costs what it costs without temporal caching, less the search for places. Places add
up, too, as surfaces come nearer and go: one whose pixels are all reached by two others ends when it is renewed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.limits import limited
from renderers.transport.caching.placement import Placement, fill
from renderers.transport.caching.records import Float, Records, Sites
from renderers.transport.caching.sight import Blocked, in_sight
from renderers.transport.caching.splat import Canvas
from renderers.transport.raycast import caster_of
from renderers.transport.temporal.anchors import anchors, departures
from renderers.transport.temporal.chords import first_of_a_place, lengthened
from renderers.transport.temporal.coverage import coverage, needed
from renderers.transport.temporal.lifespan import FOREVER, change_rate, dark_level, lifespan, staggered
from renderers.transport.temporal.motion import Motion
from renderers.transport.temporal.records import Timed
from renderers.transport.temporal.sampling import Ahead, TemporalSampler
from renderers.transport.temporal.trends import Trends
from renderers.transport.temporal.worth import priced, worthless

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Keeping = Literal["temporal", "per-frame", "static"]
MOST_STRIKES = 4
OTHERS = 2  # that must reach all pixels of a place that ends: with one, errors under a moving light rise by a fifth


@dataclass(frozen=True)
class Policy:
    """a_t and δ_max (longest); keeping: how records outlive their frame; guard, stagger: see `cache` and `lifespan.staggered`;
    frozen: no trends; follows: places go with surfaces that move; together: see `lifespan.change_rate`; curved: lives by
    `chords`, too."""

    a_t: float = 0.05
    longest: int = 20
    keeping: Keeping = "temporal"
    guard: bool = True
    stagger: bool = True
    frozen: bool = False
    follows: bool = True
    curved: bool = False
    together: bool = False

    @property
    def foresees(self) -> bool:
        """Whether lifespans depend on the next frame at all."""
        return self.keeping == "temporal" and self.longest > 1


class View(NamedTuple):
    """Pixels of one G-buffer that records are splatted on, and what `placement` needs to know of them."""

    canvas: Canvas
    sites: Sites


class Stage(NamedTuple):
    """What one frame is computed with. still: nothing changes between this frame and the next; changed: frame since which nothing
    has changed. ahead: foresees records; None: nothing to foresee. past: what led from the frame before to this one, if known."""

    frame: int
    sampler: TemporalSampler
    distances: TemporalSampler
    ahead: Ahead | None
    placement: Placement
    still: bool
    changed: int
    past: Motion | None = None

    @property
    def blocked(self) -> Blocked | None:
        """What hides a point from another, for placements that see."""
        return caster_of(self.sampler.world).occluded if self.placement.sees else None


class Computed(NamedTuple):
    """Records before limits at their sites, now and one frame later, and whether the latter was foreseen, bool (K,)."""

    sites: Sites
    now: Records
    later: Records
    foreseen: NDArray[np.bool_]

    @staticmethod
    def joined(parts: Sequence[Computed]) -> Computed:
        """All of them, in order; at least one."""
        sites = Sites(*(np.concatenate(column) for column in zip(*(part.sites for part in parts), strict=True)))
        now, later = Records.joined([part.now for part in parts]), Records.joined([part.later for part in parts])
        return Computed(sites, now, later, np.concatenate([part.foreseen for part in parts]))


@dataclass
class TemporalCache:
    """The records of one run through an animation. live: those after the latest `step`, by place."""

    policy: Policy
    live: Timed = field(default_factory=Timed.empty)
    places: int = 0
    least: float | None = None

    def step(self, stage: Stage, views: Sequence[View], counters: Counter[str]) -> Timed:
        """Go on to the next frame: renew, splat, fill; canvases then hold its irradiance. Returns the renewed records.

        Counts records_new, records_renewed, records_kept (renewed without being computed), records_deleted and records_alive.
        """
        if self.policy.keeping == "per-frame":
            self.live, self.places = Timed.empty(), 0
        few = priced((view.canvas for view in views), self.live, self.policy.longest, stage.still)
        renewed = self.renew(stage, counters, views, few)
        spare = self._spare(renewed, stage, views)
        self.live = replace(self.live, life=np.where(np.isin(self.live.place, spare), 1, self.live.life))
        values = self.live.at(stage.frame)
        placement = stage.placement
        made, resting = list[Computed](), self._rests_everywhere()

        def compute(sites: Sites, first: int = 0) -> Records:
            place = self.places + np.arange(first - len(self.live), first - len(self.live) + len(sites.position))
            ahead = None if resting else stage.ahead
            now, later = stage.sampler.sample(sites, place, ahead)
            made.append(Computed(sites, now, later, np.full(len(place), ahead is not None or stage.still)))
            return now

        for view in views:
            view.canvas.add(values, placement.a, placement.weight, placement.gradients, counters)
            values = fill(view.canvas, view.sites, compute, stage.distances.distances, placement, values, blocked=stage.blocked)
        self._adopt(stage, values.rows(slice(len(self.live), None)), made, counters)
        self.live = cover(self.live, stage, views)
        self.live = replace(self.live, covered=np.where(np.isin(self.live.place, spare), 0, self.live.covered))
        counters["records_alive"] += len(self.live)
        return renewed

    def renew(self, stage: Stage, counters: Counter[str], views: Sequence[View] = (), few: float = 0) -> Timed:
        """Delete or compute anew all records whose life is over. Returns the new ones.

        views: of this frame. With them, and where the guard rests most places, those whose records live for one frame are given up
        where others reach all of their pixels: else places that accumulate from frame to frame would cost more than those that
        a cache of one frame needs. Elsewhere they stay: what comes and goes with them would flicker. few: see `worth.worthless`.
        """
        if self.policy.follows and stage.past is not None:
            self.live = self.live.carried(*departures(stage.past, self.live.sites))
        over = self.live.last < stage.frame
        old = self.live.rows(over & (self.live.covered > 0) & ~worthless(self.live, few))
        old = old.rows(anchors(stage.sampler.world, old.sites).held)
        if views and self._rests_everywhere():
            old = old.rows(self._needed(self.live.rows(~over), old, stage.placement, views))
        counters["records_deleted"] += int(np.count_nonzero(over)) - len(old)
        counters["records_renewed"] += len(old)
        same = (old.born >= stage.changed) & stage.still
        counters["records_kept"] += int(same.sum())
        resting = ~same & (old.rest > 0)
        renewed = Timed.joined(
            self._kept(old.rows(same), stage.frame),
            self._computed(old.rows(resting), stage, None, views),
            self._computed(old.rows(~same & ~resting), stage, stage.ahead, views),
        )
        self.live = _by_place(Timed.joined(self.live.rows(~over), renewed))
        return _by_place(renewed)

    def _spare(self, renewed: Timed, stage: Stage, views: Sequence[View]) -> I64:
        """Places (S,) of records just renewed whose pixels OTHERS reach too: they serve this frame, and aren't renewed again.

        They were computed all the same, since the records before them are interpolated towards them: what earlier frames show may
        not depend on records that came later, or a range would show something else than its beginning by itself.
        """
        if not (self.policy.guard and self.policy.foresees) or stage.still or not len(renewed):
            return renewed.place[:0]
        others = self.live.rows(~np.isin(self.live.place, renewed.place))
        both = Records.joined([others.records, renewed.records])
        kept, placement = np.arange(len(both)) < len(others), stage.placement
        for view in views:
            kept = kept | needed(view.canvas, both, kept, placement.a, placement.weight, OTHERS)
        return renewed.place[~kept[len(others) :]]

    def _needed(self, valid: Timed, old: Timed, placement: Placement, views: Sequence[View]) -> NDArray[np.bool_]:
        """Which of the records to renew, (K,), were foreseen to last, or reach pixels that no other does."""
        if not old.strikes.any():
            return np.ones(len(old), bool)
        both = Records.joined([valid.records, old.records])
        sure = np.concatenate([np.ones(len(valid), bool), old.strikes == 0])
        for view in views:
            # what one view needs is there in the next
            sure = sure | needed(view.canvas, both, sure, placement.a, placement.weight)
        return np.asarray(sure[len(valid) :])

    def _kept(self, old: Timed, frame: int) -> Timed:
        """Records that would come out as they are."""
        count = len(old)
        life = np.full(count, self.policy.longest)
        kept = Timed.of(old.records, Trends.none(count), old.sites, old.place, frame, life, 0 * old.strikes, 0 * old.rest)
        return replace(kept.turned_as(old), slope=0 * old.slope, span=frame - old.born)

    def _computed(self, old: Timed, stage: Stage, ahead: Ahead | None, views: Sequence[View]) -> Timed:
        """Successors, their light foreseen where `ahead` is given; they see their zones of the views, if the placement does."""
        if not len(old):
            return Timed.empty()
        now, later = stage.sampler.sample(old.sites, old.place, ahead, old.tangents)
        foreseen = np.full(len(old), ahead is not None or stage.still)
        # neighbours among records that are still to come would make a frame depend on those after it
        placement, blocked = stage.placement, stage.blocked
        records = limited(now, replace(placement.limits, neighbours=False))
        if blocked is not None:
            for view in views:
                records = in_sight(records, view.canvas, placement.a, placement.weight, blocked)
        computed = Computed(old.sites, now, later, foreseen)
        new = self._timed(stage.frame, records, computed, old.place, old.strikes, old.rest).turned_as(old)
        if not self.policy.curved:
            return new
        assert self.least is not None
        return lengthened(new, old, now, later, foreseen, self.least, self.policy.a_t, self.policy.longest)

    def _adopt(self, stage: Stage, records: Records, made: list[Computed], counters: Counter[str]) -> None:
        """Take in records of new places."""
        counters["records_new"] += len(records)
        if not made:
            return
        found = Computed.joined(made)
        if self.least is None:
            self.least = dark_level(found.now)
        place = self.places + np.arange(len(records))
        strikes = np.where(found.foreseen, 0, MOST_STRIKES)
        rest = np.where(found.foreseen, 0, 1 + place % 2**MOST_STRIKES)
        new = self._timed(stage.frame, records, found, place, strikes, rest)
        if self.policy.stagger and self.policy.keeping == "temporal":
            new = replace(new, life=staggered(new.life, place, self.policy.longest))
        if self.policy.curved:
            new = first_of_a_place(new, found.now, found.later, found.foreseen)
        self.places += len(records)
        self.live = Timed.joined(self.live, new)

    def _timed(self, frame: int, records: Records, computed: Computed, place: I64, strikes: I64, rest: I64) -> Timed:
        """Records with their lifespans and foreseen trends."""
        sites, now, later, foreseen = computed
        count = len(records)
        trends = Trends.none(count)
        if self.policy.foresees and not self.policy.frozen:
            trends = Trends.between(now, later, np.ones(count)).shrunk(_shrinkage(now.translation, records.translation))
        if self.policy.keeping != "temporal":
            life = np.full(count, FOREVER if self.policy.keeping == "static" else 1)
            return Timed.of(records, trends, sites, place, frame, life, strikes, rest)
        assert self.least is not None
        life = lifespan(change_rate(now, later, self.least, self.policy.together), self.policy.a_t, self.policy.longest)
        life = np.where(foreseen, life, 1)
        strikes = np.where(foreseen, np.where(life > 1, 0, np.minimum(strikes + 1, MOST_STRIKES)), strikes)
        rest = np.where(foreseen, np.where(strikes > 0, 2**strikes - 1, 0), np.maximum(rest - 1, 0))
        return Timed.of(records, trends, sites, place, frame, life, strikes, rest if self.policy.guard else 0 * rest)

    def _rests_everywhere(self) -> bool:
        """Whether most places are computed without foresight at present."""
        return self.policy.guard and len(self.live) > 0 and float(np.mean(self.live.strikes > 0)) > 0.5


def cover(live: Timed, stage: Stage, views: Sequence[View]) -> Timed:
    """Count the pixels that records in their last frame reach."""
    ending = np.flatnonzero(live.last == stage.frame)
    if not len(ending):
        return live
    covered = live.covered.copy()
    records, placement = live.records.rows(ending), stage.placement
    covered[ending] = sum(coverage(view.canvas, records, placement.a, placement.weight) for view in views)
    return replace(live, covered=covered)


def _by_place(timed: Timed) -> Timed:
    order = np.argsort(timed.place, kind="stable")
    return timed.rows(order)


def _shrinkage(before: Float, after: Float) -> F64:
    """How much limits shortened translation gradients (K, 3, 3): (K,), at most 1."""
    old, new = (np.linalg.norm(a.reshape(len(a), -1), axis=1) for a in (before, after))
    return np.asarray(np.where(old > 0, new / np.where(old > 0, old, 1), 1.0))
