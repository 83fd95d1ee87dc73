"""Do the intervals that references state hold what they promise?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import renderers
from renderers.images import luminance
from renderers.reference import render

pytestmark = pytest.mark.mitsuba


@pytest.mark.parametrize(("spp", "n"), [(64, 48), (256, 16)])
def test_95_percent_intervals_hold_in_95_percent_of_pixels(spp: int, n: int) -> None:
    """The fewest replicates that a reference may have, ten times over, against the mean of all N = 10 n.

    That mean M contains the tested one, m: var(m - M) = σ²/n · (1 - n/N), so the interval about m is shrunk by √(1 - n/N).
    """
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, reference_stream
    from renderers.reference.transports import estimator

    scene, size = renderers.load_scene("cornell-box"), (32, 24)
    traced = mitsuba_scene(scene.world(), size)
    path = estimator("one-bounce", traced)
    empty = render(scene, "one-bounce", size, noise=1.0)
    surface = empty.surface
    replicates = np.array([mean_image(traced, path, size, spp, reference_stream(k), CENTRE) for k in range(10 * n)])
    truth = luminance(replicates.mean(axis=0))
    held = []
    for group in replicates.reshape(10, n, *replicates.shape[1:]):
        squares_y = (luminance(group) ** 2).sum(axis=0)
        reference = replace(empty, total=group.sum(axis=0), squares=(group**2).sum(axis=0), squares_y=squares_y, n=n)
        low, high = reference.interval(0.95)
        held.append((np.abs(truth - (low + high) / 2) <= (high - low) / 2 * np.sqrt(1 - 1 / 10))[surface])
    assert surface.sum() > 300
    coverage = float(np.mean(held))
    assert 0.93 < coverage < 0.97
