"""Do the intervals that references state hold what they promise?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import renderers
from renderers.images import luminance
from renderers.reference import render

pytestmark = pytest.mark.mitsuba


def test_95_percent_intervals_hold_in_95_percent_of_pixels() -> None:
    """16 replicates of 64 samples, five times over, against 512 further replicates; the truth's own variance (1/32) widens nothing by over 2 %."""
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, reference_stream
    from renderers.reference.transports import estimator

    scene, size = renderers.load_scene("cornell-box"), (32, 24)
    traced = mitsuba_scene(scene.world(), size)
    path = estimator("one-bounce", traced)
    empty = render(scene, "one-bounce", size, noise=1.0)
    surface = empty.surface
    replicates = np.array([mean_image(traced, path, size, 64, reference_stream(k), CENTRE) for k in range(592)])
    truth = luminance(replicates[80:].mean(axis=0))
    held = []
    for group in replicates[:80].reshape(5, 16, *replicates.shape[1:]):
        reference = replace(
            empty, total=group.sum(axis=0), squares=(group**2).sum(axis=0), squares_y=(luminance(group) ** 2).sum(axis=0), n=16
        )
        low, high = reference.interval(0.95)
        held.append(((low <= truth) & (truth <= high))[surface])
    assert surface.sum() > 300
    assert 0.93 < np.mean(held) < 0.97
