"""Frames that wait to be drawn: interpolation needs the successors of all their records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.method import Context
from renderers.scene.world import WorldCamera
from renderers.transport.temporal.cache import View
from renderers.transport.temporal.records import Timed, succeeded


@dataclass
class Pending:
    """A frame whose records are known, but perhaps not all of their successors. open (K,): records that wait for theirs."""

    context: Context
    views: list[View]
    albedo: list[NDArray[np.float64]]
    direct: NDArray[np.float64]
    records: Timed
    open: NDArray[np.bool_]
    counters: Counter[str]
    camera: WorldCamera
    position: NDArray[np.float32]

    @property
    def settled(self) -> bool:
        """Whether it can be drawn."""
        return not self.open.any()


def hand_over(waiting: Iterable[Pending], renewed: Timed, frame: int) -> None:
    """Give the records of a frame to earlier frames that wait for them, and stop waiting for records that won't come."""
    for earlier in waiting:
        if not earlier.settled:
            earlier.records, earlier.open = succeeded(earlier.records, earlier.open, renewed, frame)
