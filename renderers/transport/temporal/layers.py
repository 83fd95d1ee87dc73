"""What each cache gives the frames of an animation: irradiance for diffuse pixels, radiance for glossy ones.

A `Share` is a cache's part of one frame, which may have to wait for the successors of its records. A `Layer` is a cache on its way
through the animation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.placement import Placement
from renderers.transport.temporal.cache import Policy, Stage, TemporalCache, cover
from renderers.transport.temporal.records import Timed, succeeded
from renderers.transport.temporal.views import Look

F64 = NDArray[np.float64]


@dataclass
class Share:
    """One cache's part of a frame. looks: of each view; open (K,): records that wait for their successors; waited (K,): those that
    did at first; successors: those that came, frame by frame."""

    looks: list[Look]
    records: Timed
    open: NDArray[np.bool_]
    placement: Placement
    successors: list[Timed] = field(default_factory=list)
    waited: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.waited = self.open

    @property
    def settled(self) -> bool:
        """Whether it can be drawn."""
        return not self.open.any()

    def light(self, view: int, frame: int, again: bool, counters: Counter[str]) -> F64:
        """What the pixels of a view reflect in a frame, (P, 3); again: records were splatted on canvases before they had trends."""
        look = self.looks[view]
        if look.lobes is None and not again:
            return look.reflected
        return look.light(self.records.at(frame), self.placement, counters)


@dataclass
class Layer:
    """A cache. waits: its frames wait for the successors of their records."""

    policy: Policy
    waits: bool
    cache: TemporalCache = field(init=False)

    def __post_init__(self) -> None:
        self.cache = TemporalCache(self.policy)

    def share(self, stage: Stage, looks: list[Look], earlier: Iterable[Share], counters: Counter[str]) -> Share:
        """Go on to the next frame: its part of it. Those of earlier frames get the successors that they wait for."""
        before = counters["records"]
        renewed = self.cache.step(stage, [look.view for look in looks], counters)
        if stage.sampler.order is not None:
            counters["radiance_records"] += counters["records"] - before
        hand_over(earlier, renewed, stage.frame)
        live = self.cache.live
        # a record of one frame has no trend to wait for
        return Share(looks, live, (live.life > 1) & self.waits, stage.placement)

    def look_ahead(self, stage: Stage, last: int, looks: Callable[[], list[Look]], earlier: Sequence[Share]) -> None:
        """One frame past the range that ends with `last`: successors of the records that live in its last frames, and nothing else.

        looks: of that frame, asked for where records end in it.
        """
        live = self.cache.live
        self.cache.live = live.rows((live.born <= last) & (live.life > 1))
        hand_over(earlier, self.cache.renew(stage._replace(ahead=None), Counter()), stage.frame)
        live = self.cache.live
        self.cache.live = live.rows(live.born <= last)
        if (self.cache.live.last == stage.frame).any():
            self.cache.live = cover(self.cache.live, stage, [look.view for look in looks()])


def hand_over(waiting: Iterable[Share], renewed: Timed, frame: int) -> None:
    """Give the records of a frame to parts of earlier ones that wait for them, and stop waiting for records that won't come.

    Those whose last successors came join them all at once.
    """
    for earlier in waiting:
        if not earlier.settled:
            earlier.successors.append(renewed)
            earlier.open = earlier.open & (earlier.records.last >= frame)
            if not earlier.open.any():
                earlier.records, _ = succeeded(earlier.records, earlier.waited, Timed.joined(*earlier.successors), frame)
                earlier.successors.clear()
