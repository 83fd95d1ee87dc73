"""What the noise of references adds to flicker: predicted from their own replicates, and measured against better references."""

from __future__ import annotations

import pytest

import renderers
from renderers import reference
from reports import Noise, flicker_floor, measure_change
from reports.metrics import Pair

pytestmark = pytest.mark.mitsuba

SIZE = (32, 24)


def rendered(scene: renderers.Scene, noise: float, frame: int) -> reference.Reference:
    return reference.render(scene, "one-bounce", size=SIZE, noise=noise, frame=frame)


def test_the_predicted_flicker_of_the_noise_is_the_measured_one() -> None:
    scene = renderers.load_scene("cube-in-a-box")
    coarse, fine = (
        [reference.render(scene, "one-bounce", size=SIZE, noise=noise, frame=frame) for frame in (20, 21)]
        for noise in (0.05, 0.008)
    )
    exposure = reference.exposure(coarse[0])
    measured = measure_change(*(Pair(a.image, b.image, exposure) for a, b in zip(coarse, fine, strict=True)))["flicker"]
    predicted = flicker_floor(*(Noise(a.image, a.variance, a.noise_sample) for a in coarse), exposure)["flicker"]
    at_most = flicker_floor(*(Noise(a.image, a.variance) for a in coarse), exposure)["flicker"]
    assert measured is not None
    assert predicted is not None
    assert at_most is not None
    # The fine references go on with the coarse ones' replicates, so the difference has the standard deviation
    # sqrt(1 - n/N) of the coarse error's. Both are means over 768 pixels of a heavy-tailed change: within a third of one another.
    share = (1 - coarse[0].n / fine[0].n) ** 0.5
    assert measured == pytest.approx(share * predicted, rel=0.33)
    # Shared random numbers: the cube's small step leaves the noise nearly where it was.
    assert predicted < 0.2 * at_most
