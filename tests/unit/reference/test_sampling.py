"""Streams and pass sizes of the sampling loop."""

from __future__ import annotations

from math import isqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytestmark = pytest.mark.mitsuba


@given(st.integers(1, 5000))
def test_grid_sizes_add_up_and_fit_multijitter(spp: int) -> None:
    from renderers.reference.sampling import grid_sizes

    sizes = grid_sizes(spp)
    assert sum(sizes) == spp
    assert all(isqrt(s) * -(-s // isqrt(s)) == s and s <= 256 for s in sizes)


@given(st.integers(0, 65535), st.integers(0, 1000), st.integers(-(2**31), 2**31), st.integers(0, 100))
def test_pictures_never_share_paths_with_their_truth(replicate: int, band: int, seed: int, number: int) -> None:
    from renderers.reference.sampling import method_stream, reference_stream

    assert reference_stream(replicate)(0) == replicate
    assert reference_stream(replicate)(band) < 1 << 31 <= method_stream(seed, number)(band) < 1 << 32


def test_replicates_beyond_the_stream_are_refused() -> None:
    from renderers.reference.sampling import reference_stream

    with pytest.raises(ValueError, match="65536"):
        reference_stream(65536)


def test_bands_of_rows_cover_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut into bands of two rows, a picture without noise is the same."""
    import numpy as np

    import renderers
    from renderers.reference import sampling
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.transports import estimator

    scene = mitsuba_scene(renderers.load_scene("cornell-box").world(), (16, 9))
    direct = estimator("direct", scene)
    whole = sampling.mean_image(scene, direct, (16, 9), 4, sampling.reference_stream(0), sampling.CENTRE)
    monkeypatch.setattr(sampling, "LANES", 2 * 16 * 4)
    cut = sampling.mean_image(scene, direct, (16, 9), 4, sampling.reference_stream(0), sampling.CENTRE)
    np.testing.assert_allclose(cut, whole, rtol=1e-6)


def test_a_path_that_is_not_finite_is_an_error() -> None:
    import renderers
    from renderers.reference.export import mi, mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, reference_stream

    scene = mitsuba_scene(renderers.load_scene("cornell-box").world(), (4, 3))

    def broken(scene: object, sampler: object, ray: object, active: object) -> object:
        return mi.Color3f(float("nan")) + 0 * ray.o.x  # type: ignore[attr-defined]

    with pytest.raises(FloatingPointError, match="not finite"):
        mean_image(scene, broken, (4, 3), 4, reference_stream(0), CENTRE)
