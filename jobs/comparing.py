"""Compare images of an evaluation folder with their references: the one place that calls the reports' metrics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from renderers.images import read_exr

Metrics = dict[str, float | None]


@dataclass(frozen=True, eq=False)
class ReferenceImage:
    """A reference as it lies in the folder: float32 mean and variance (H, W, 3), luminance_variance (H, W), replicates."""

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    luminance_variance: NDArray[np.float32]
    n: int

    @classmethod
    def read(cls, path: Path) -> ReferenceImage:
        """Read `references/<id>.exr`."""
        layers, attributes = read_exr(path)
        return cls(layers["mean"], layers["variance"], layers["luminance_variance"], int(attributes["n"]))


def against(test: NDArray[np.float32], reference: ReferenceImage, exposure: float) -> Metrics:
    """Every metric of one image against one reference."""
    import reports

    return dict(reports.compare(test, reference.mean, exposure, reference.luminance_variance, reference.n))


def noise_floor(reference: ReferenceImage, exposure: float) -> Metrics:
    """Metrics that the reference's own noise alone produces."""
    import reports

    return dict(reports.noise_floor(reference.mean, reference.variance, exposure))
