"""Compare images of an evaluation folder with their references: the one place that calls the reports' metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from renderers.images import read_exr
from reports.comparison import Noise
from reports.metrics import Pair

Metrics = dict[str, float | None]


@dataclass(frozen=True, eq=False)
class ReferenceImage:
    """A reference as it lies in the folder: float32 mean and variance (H, W, 3), luminance_variance (H, W), replicates.

    noise_sample: float32 (H, W, 3), None where it isn't known; revealed: bool (H, W), None where nothing moves.
    """

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    luminance_variance: NDArray[np.float32]
    n: int
    noise_sample: NDArray[np.float32] | None = None
    revealed: NDArray[np.bool_] | None = None

    @classmethod
    def read(cls, path: Path) -> ReferenceImage:
        """Read `references/<id>.exr`."""
        layers, attributes = read_exr(path)
        revealed = layers["revealed"] > 0 if "revealed" in layers else None
        n, sample = int(attributes["n"]), layers.get("noise_sample")
        return cls(layers["mean"], layers["variance"], layers["luminance_variance"], n, sample, revealed)

    @property
    def noise(self) -> Noise:
        """What is known of its noise."""
        return Noise(self.mean, self.variance, self.noise_sample)

    def pair(self, test: NDArray[np.float32], exposure: float) -> Pair:
        """A test image beside this reference and what is known of it."""
        return Pair(test, self.mean, exposure, self.luminance_variance, self.n, self.revealed)


def against(test: NDArray[np.float32], reference: ReferenceImage, exposure: float) -> Metrics:
    """Every metric of one image against one reference."""
    import reports

    return dict(reports.measure(reference.pair(test, exposure)))


class Comparison:
    """The frames of one render against their references, one after the other: consecutive ones also show what changes."""

    def __init__(self, exposure: float) -> None:
        self.exposure = exposure
        self._before: dict[tuple[str, int], tuple[ReferenceImage, Pair]] = {}

    def frame(
        self, number: int, test: NDArray[np.float32], references: Mapping[str, ReferenceImage]
    ) -> tuple[dict[str, Metrics], dict[str, Metrics]]:
        """Metrics, and those that the references' noise alone produces, by the references' roles; none without references."""
        import reports

        metrics, floors, kept = dict[str, Metrics](), dict[str, Metrics](), dict[tuple[str, int], tuple[ReferenceImage, Pair]]()
        for role, reference in references.items():
            pair = reference.pair(test, self.exposure)
            metrics[role] = dict(reports.measure(pair))
            floors[role] = dict(reports.noise_floor(reference.mean, reference.variance, self.exposure))
            if (role, number - 1) in self._before:
                earlier, before = self._before[role, number - 1]
                metrics[role] |= reports.measure_change(before, pair)
                floors[role] |= reports.flicker_floor(earlier.noise, reference.noise, self.exposure)
            kept[role, number] = reference, pair
        self._before = kept
        return metrics, floors
