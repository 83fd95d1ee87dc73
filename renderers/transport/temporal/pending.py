"""Frames that wait to be drawn: interpolation needs the successors of all their records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.frame import Frame
from renderers.method import Context
from renderers.scene.world import WorldCamera
from renderers.transport.caching.reflectance import Gloss
from renderers.transport.caching.traced import notes_on_lobes
from renderers.transport.temporal.layers import Share
from renderers.transport.temporal.overlay import overlay
from renderers.transport.temporal.views import Traced

F64 = NDArray[np.float64]
CAPTION = "records of this frame; red: lives one frame, yellow: half as long as delta_max, green: delta_max frames"


@dataclass
class Pending:
    """A frame whose records are known, but perhaps not all of their successors. shares: by cache; direct (H, W, 3): sum over the
    views; traced, alone: lobes too sharp for records and pixels too few for them, of each view; position (H, W, 3): what the first
    view sees."""

    context: Context
    shares: dict[str, Share]
    direct: F64
    traced: Sequence[Traced]
    alone: Sequence[Traced]
    counters: Counter[str]
    camera: WorldCamera
    position: NDArray[np.float32]
    gloss: Gloss | None

    @property
    def settled(self) -> bool:
        """Whether it can be drawn."""
        return all(share.settled for share in self.shares.values())

    def drawn(self, again: bool, longest: int, rays: int, notes: tuple[str, ...]) -> Frame:
        """The picture; again: see `Share.light`; longest: δ_max; rays: of each pixel traced; notes: what a result has to say."""
        context, count = self.context, len(self.traced)
        shape = self.direct.shape
        with context.watch("splat"):
            indirect = np.zeros((shape[0] * shape[1], 3))
            for view in range(count):
                indirect += self._indirect(view, again, len(indirect))
        layers = {"direct": self.direct / count, "indirect": indirect.reshape(shape) / count}
        images = {name: layer.astype(np.float32) for name, layer in layers.items()}
        images["beauty"] = images["direct"] + images["indirect"]
        timings = context.watch.timings
        records = [share.records for share in self.shares.values()]
        images["debug.records"] = overlay(records, longest, self.camera, self.position, images["indirect"])
        notes += notes_on_lobes(self.gloss, sum(len(traced.rows) for traced in self.traced), rays)
        return Frame(images, timings, dict(sorted(self.counters.items())), notes=notes, captions={"debug.records": CAPTION})

    def _indirect(self, view: int, again: bool, pixels: int) -> F64:
        """Indirect light (H·W, 3) of one view."""
        image = np.zeros((pixels, 3))
        for share in self.shares.values():
            canvas = share.looks[view].view.canvas
            image[canvas.rows] += share.light(view, self.context.frame, again, self.counters)
            self.counters["pixels_missed"] += int(np.count_nonzero(canvas.missed))
        traced = self.traced[view]
        image[traced.rows] += traced.light
        # records that later views needed may reach them, too
        image[self.alone[view].rows] = self.alone[view].light
        return image
