"""Which places are worth a record: those that serve enough pixels over the frames that it lives.

A canvas says how few pixels a record of one frame isn't worth its price for (`Canvas.few`); one that lives for several frames may
reach fewer in each. How long a new record will live isn't known before it is made: as long as those of the cache do on average.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.splat import Canvas
from renderers.transport.temporal.records import Timed


def priced(canvases: Iterable[Canvas], live: Timed, longest: int, still: bool) -> float:
    """Divide `few` of canvases by the frames that a new record will serve, given the live ones; still: nothing changes for now.

    Returns the least that is left, 0 without pixels.
    """
    lives = float(longest) if still else 1.0
    if len(live) and not still:
        lives = float(live.life.mean())
    least = np.inf
    for canvas in canvases:
        canvas.few = canvas.few / lives
        least = min(least, float(canvas.few.min(initial=np.inf)))
    return least if np.isfinite(least) else 0.0


def worthless(live: Timed, few: float) -> NDArray[np.bool_]:
    """Records (K,) that served one frame alone, and in it fewer pixels than `few`. Of others a successor is waited for."""
    return np.asarray((live.life == 1) & (live.covered < few))
