"""The published GPU layout (St-Amour 2004 §4.2): every function in the same number of slots, 16-bit depths, 8-bit hidden shares.

Three RGBA textures of 32-bit integers hold 16 vertices: two of depths, one of shares.

    depth texture 0, channel c      vertices 2c (low half), 2c + 1 (high half)       0 …  7
    depth texture 1, channel c      vertices 8 + 2c, 8 + 2c + 1                       8 … 15
    share texture, channel c        vertices 4c … 4c + 3, lowest byte first           0 … 15

Depths are linear between near and far: a half float, or a hyperbolic depth, is coarse where most events are. Unused slots have
depth 1 and the last share. Every pixel pays for the longest function; `Construction.budget` bounds that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.transport.penumbra.functions import PenumbraMap

GROUP = 16
DEPTHS, SHARES = 65535, 255


def fixed_slots(made: PenumbraMap) -> NDArray[np.uint32]:
    """Textures uint32 (3 ⌈K / 16⌉, height, width, 4) of a map whose longest function has K vertices (at least one group)."""
    p = made.pyramid
    counts = np.diff(made.start)
    groups = max(-(-int(counts.max(initial=0)) // GROUP), 1)
    depth = np.full((len(counts), groups * GROUP), DEPTHS, np.uint32)
    share = np.zeros((len(counts), groups * GROUP), np.uint32)
    full = counts > 0
    last = made.value[np.maximum(made.start[1:] - 1, 0)] if len(made.value) else np.zeros(len(counts))
    share[full] = np.rint(last[full, None] * SHARES)
    pixel = np.repeat(np.arange(len(counts)), counts)
    slot = np.arange(len(made.depth)) - made.start[:-1][pixel]
    depth[pixel, slot] = np.rint(np.clip((made.depth.astype(np.float64) - p.near) / (p.far - p.near), 0, 1) * DEPTHS)
    share[pixel, slot] = np.rint(made.value.astype(np.float64) * SHARES)
    packed = np.empty((groups, 3, len(counts), 4), np.uint32)
    for g in range(groups):
        d = depth[:, g * GROUP : (g + 1) * GROUP].reshape(-1, 2, 4, 2)
        packed[g, :2] = (d[..., 0] | d[..., 1] << np.uint32(16)).transpose(1, 0, 2)
        s = share[:, g * GROUP : (g + 1) * GROUP].reshape(-1, 4, 4)
        packed[g, 2] = s[..., 0] | s[..., 1] << np.uint32(8) | s[..., 2] << np.uint32(16) | s[..., 3] << np.uint32(24)
    return packed.reshape(groups * 3, p.height, p.width, 4)
