"""What a method returns: linear layers, timings and exact work counts."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

LAYERS = ("direct", "indirect", "beauty")
DIAGNOSTIC = re.compile(r"debug\.[a-z0-9]+(-[a-z0-9]+)*")  # names of layers that show how a method worked


@dataclass(frozen=True)
class Timing:
    """Seconds of one pass. `gpu_s` is None where no GPU timer exists; `cpu_s` counts all threads of the process."""

    name: str
    wall_s: float
    cpu_s: float
    gpu_s: float | None = None
    calls: int = 1
    stage: Literal["prepare", "render"] = "render"


@dataclass(frozen=True, eq=False)
class Frame:
    """Result of one render call.

    layers: float32 (H, W, 3) each, linear radiance, row 0 on top, no tone map; `beauty` is always there, and equals `direct` +
    `indirect` where those are. A layer `debug.<name>` is a diagnostic picture: linear colours 0..1, shown as they are, without the
    scene's exposure; `captions` says of each what it shows and what its colours mean. Raises ValueError when a layer has a wrong
    shape or dtype, or a diagnostic picture a wrong name, range or no caption; FloatingPointError when one holds a NaN or an
    infinity.
    """

    layers: Mapping[str, NDArray[np.float32]]
    timings: tuple[Timing, ...] = ()
    counters: Mapping[str, int] = field(default_factory=dict)
    device: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    captions: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shape = self.layers["beauty"].shape
        for name, layer in self.layers.items():
            if layer.dtype != np.float32 or layer.ndim != 3 or layer.shape != shape or shape[2] != 3:
                raise ValueError(f"layer {name!r} must be float32 (H, W, 3), got {layer.dtype} {layer.shape}")
            bad = int(np.count_nonzero(~np.isfinite(layer)))
            if bad:
                raise FloatingPointError(f"layer {name!r} holds {bad} values that are not finite")
            if name.startswith("debug."):
                self._check_diagnostic(name)
        if unknown := sorted(set(self.captions) - set(self.layers)):
            raise ValueError(f"captions without a layer: {', '.join(unknown)}")

    def _check_diagnostic(self, name: str) -> None:
        if not DIAGNOSTIC.fullmatch(name):
            raise ValueError(f"a diagnostic layer is called debug.some-name, got {name!r}")
        if not self.captions.get(name):
            raise ValueError(f"layer {name!r} has no caption")
        if self.layers[name].min() < 0 or self.layers[name].max() > 1:
            raise ValueError(f"layer {name!r} must hold colours 0..1")


class Stopwatch:
    """Collects Timings of named passes: `with watch("gbuffer"): ...`; repeated names add up."""

    def __init__(self) -> None:
        self._timings: dict[tuple[str, str], Timing] = {}

    @contextlib.contextmanager
    def __call__(self, name: str, stage: Literal["prepare", "render"] = "render") -> Iterator[None]:
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.add(Timing(name, time.perf_counter() - wall, time.process_time() - cpu, stage=stage))

    def add(self, timing: Timing) -> None:
        """Add one measurement, summed with earlier ones of the same name and stage."""
        key = (timing.name, timing.stage)
        old = self._timings.get(key)
        if old is not None:
            gpu = None if old.gpu_s is None or timing.gpu_s is None else old.gpu_s + timing.gpu_s
            timing = Timing(
                timing.name, old.wall_s + timing.wall_s, old.cpu_s + timing.cpu_s, gpu, old.calls + timing.calls, timing.stage
            )
        self._timings[key] = timing

    @property
    def timings(self) -> tuple[Timing, ...]:
        """All passes in the order of their first call."""
        return tuple(self._timings.values())
