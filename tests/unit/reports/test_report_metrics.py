"""Metrics against formulas written a second time, and against what must hold for all images."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import gaussian_filter

from renderers.images import LUMA, display_values
from reports import Noise, compare, flicker_floor, measure, measure_change, noise_floor
from reports.comparison import reference_too_noisy
from reports.metrics import (
    OVER,
    UNDECIDED,
    Pair,
    flicker,
    flicker_linear,
    over_states,
    possibly_mask,
    signed_relative_error,
    surely_mask,
)
from reports.registry import METRICS
from reports.registry_page import page

SHAPE = (12, 13, 3)
images = arrays(np.float32, SHAPE, elements=st.floats(0, 4, width=32))
exposures = st.floats(0.01, 10)


def encode(value: float) -> float:
    """The sRGB curve on one value, from IEC 61966-2-1."""
    value = min(max(value, 0.0), 1.0)
    return 255 * (12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055)


def luma(pixel: np.ndarray, exposure: float) -> float:
    return sum(w * encode(exposure * float(v)) for w, v in zip((0.2126, 0.7152, 0.0722), pixel, strict=True))


def two_images(seed: int = 0, shape: tuple[int, int, int] = SHAPE) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    reference = rng.random(shape).astype(np.float32)
    return (reference * (1 + 0.03 * rng.standard_normal(shape))).clip(0).astype(np.float32), reference


def test_rmse_and_over_2pct_pixel_by_pixel() -> None:
    test, reference = two_images()
    row = compare(test, reference, 0.9)
    squares, over, over_linear = [], [], []
    mean_y = np.mean([[0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in line] for line in reference.astype(float)])
    for t, r in zip(test.reshape(-1, 3), reference.reshape(-1, 3), strict=True):
        squares += [(encode(0.9 * float(a)) - encode(0.9 * float(b))) ** 2 for a, b in zip(t, r, strict=True)]
        lt, lr = luma(t, 0.9), luma(r, 0.9)
        over.append(abs(lt - lr) > 0.02 * max(lr, 1))
        yt, yr = (float(np.dot((0.2126, 0.7152, 0.0722), v.astype(float))) for v in (t, r))
        over_linear.append(abs(yt - yr) > 0.02 * max(yr, 0.01 * mean_y))
    assert row["rmse"] == pytest.approx(math.sqrt(math.fsum(squares) / len(squares)), rel=1e-12)
    assert row["over_2pct"] == np.mean(over)
    assert row["over_2pct_linear"] == np.mean(over_linear)
    assert 0 < row["over_2pct"] < 1


def test_display_values_are_not_rounded() -> None:
    reference = np.full(SHAPE, 0.5, np.float32)
    row = compare(reference * np.float32(1.001), reference)
    assert 0 < row["rmse"] < 0.1


def test_ssim_from_wang_2004() -> None:
    test, reference = two_images(shape=(24, 31, 3))
    x, y = (np.apply_along_axis(luma, 2, image, 1.0) for image in (test, reference))
    blur = lambda image: gaussian_filter(image, 1.5, truncate=3.5)  # noqa: E731
    mx, my = blur(x), blur(y)
    vx, vy, cov = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    expected = np.mean((2 * mx * my + c1) * (2 * cov + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2)))
    assert compare(test, reference)["ssim"] == pytest.approx(expected, abs=1e-9)


def test_hdr_metrics() -> None:
    test, reference = two_images()
    row = compare(test, reference, 7.0)
    t, r = test.astype(float), reference.astype(float)
    assert row["rel_mse"] == pytest.approx(np.mean((t - r) ** 2 / (r * r + 0.01)), rel=1e-12)
    assert compare(reference * np.float32(1.25), reference)["mean_bias"] == pytest.approx(0.25, rel=1e-6)
    assert compare(reference * np.float32(0.5), reference)["mean_bias"] == pytest.approx(-0.5, rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(images, exposures)
def test_identical_images_are_exact(image: np.ndarray, exposure: float) -> None:
    row = compare(image, image.copy(), exposure)
    assert (row["rmse"], row["ssim"], row["over_2pct"]) == (0.0, 1.0, 0.0)
    assert (row["over_2pct_linear"], row["rel_mse"], row["mean_bias"]) == (0.0, 0.0, 0.0)


@settings(max_examples=30, deadline=None)
@given(images, images, exposures, arrays(np.float32, SHAPE[:2], elements=st.floats(0, 0.25, width=32)))
def test_every_metric_stays_in_its_range(test: np.ndarray, reference: np.ndarray, exposure: float, variance: np.ndarray) -> None:
    row = compare(test, reference, exposure, variance, 16)
    assert 0 <= row["rmse"] <= 255
    assert -1 <= row["ssim"] <= 1
    assert 0 <= row["over_2pct_surely"] <= row["over_2pct"] <= row["over_2pct_possibly"] <= 1
    assert all(value is None or math.isfinite(value) for value in row.values())
    assert row["rmse"] == compare(reference, test, exposure)["rmse"]


@settings(max_examples=30, deadline=None)
@given(images, images, arrays(np.float32, SHAPE[:2], elements=st.floats(0, 0.25, width=32)), st.floats(0, 1))
def test_bounds_hold_for_every_value_of_the_interval(
    test: np.ndarray, reference: np.ndarray, variance: np.ndarray, where: float
) -> None:
    pair = Pair(test, reference, 1.0, variance, 16)
    low, high = pair.reference_interval
    r = np.clip(low + where * (high - low), low, high)
    over = np.abs(pair.test_luma - r) > 0.02 * np.maximum(r, 1)
    assert not (surely_mask(pair) & ~over).any()
    assert not (over & ~possibly_mask(pair)).any()
    states = over_states(pair)
    assert np.array_equal(states == OVER, surely_mask(pair))
    assert np.array_equal(states == UNDECIDED, possibly_mask(pair) & ~surely_mask(pair))


def test_interval_is_students_t_through_the_tone_curve() -> None:
    reference = np.full(SHAPE, (0.4, 0.2, 0.1), np.float32)
    y = float(reference[0, 0].astype(float) @ (0.2126, 0.7152, 0.0722))
    variance = np.full(SHAPE[:2], (0.1 * y) ** 2)
    low, high = Pair(reference, reference, 1.3, variance, 4).reference_interval
    # t(0.975, 3 degrees of freedom) = 3.1824: luminance moves by ± 31.824 %, and every channel with it.
    assert low[0, 0] == pytest.approx(luma(reference[0, 0].astype(float) * (1 - 0.31824463), 1.3), rel=1e-6)
    assert high[0, 0] == pytest.approx(luma(reference[0, 0].astype(float) * (1 + 0.31824463), 1.3), rel=1e-6)


def test_interval_of_a_black_pixel_is_grey() -> None:
    black = np.zeros(SHAPE, np.float32)
    low, high = Pair(black, black, 1.0, np.full(SHAPE[:2], 1e-4), 16).reference_interval
    assert low.max() == 0
    assert high[0, 0] == pytest.approx(luma(np.full(3, 2.1314495 * 0.01), 1.0), rel=1e-6)


def test_too_noisy_is_about_undecided_pixels() -> None:
    row = {"over_2pct_surely": 0.1, "over_2pct_possibly": 0.25}
    assert not reference_too_noisy(row)
    assert reference_too_noisy(row, 0.05)
    assert reference_too_noisy({"over_2pct_surely": 0.1, "over_2pct_possibly": 0.31})
    assert not reference_too_noisy({})


def test_black_reference() -> None:
    test, black = two_images()[0], np.zeros(SHAPE, np.float32)
    row = compare(test, black, nightly=True)
    assert row["mean_bias"] is None
    assert row["flip_hdr"] is None
    assert row["over_2pct_linear"] == 1
    assert row["rel_mse"] == pytest.approx(float(np.mean(test.astype(float) ** 2)) / 0.01)
    assert np.array_equal(signed_relative_error(Pair(test, black)), np.ones(SHAPE[:2], np.float32))
    assert compare(black, black, nightly=True)["mean_bias"] == 0


def test_small_images_have_no_ssim() -> None:
    image = np.ones((10, 40, 3), np.float32)
    assert compare(image, image)["ssim"] is None


@pytest.mark.parametrize(
    ("test", "reference", "more", "message"),
    [
        (np.ones((4, 4, 3)), np.ones((4, 5, 3)), {}, "must both be"),
        (np.ones((4, 4)), np.ones((4, 4)), {}, "must both be"),
        (np.full((4, 4, 3), np.nan), np.ones((4, 4, 3)), {}, "finite"),
        (np.ones((4, 4, 3)), np.ones((4, 4, 3)), {"exposure": 0.0}, "exposure"),
        (np.ones((4, 4, 3)), np.ones((4, 4, 3)), {"luminance_variance": np.ones((4, 4))}, "replicates"),
        (np.ones((4, 4, 3)), np.ones((4, 4, 3)), {"luminance_variance": -np.ones((4, 4)), "n": 4}, "not negative"),
    ],
)
def test_bad_input_is_refused(test: np.ndarray, reference: np.ndarray, more: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        compare(test, reference, **more)


def test_flip_sees_a_difference_and_runs_only_at_night() -> None:
    test, reference = two_images()
    assert "flip_hdr" not in compare(test, reference)
    assert compare(reference, reference, nightly=True)["flip_hdr"] == 0
    small, large = (compare(reference * np.float32(k), reference, nightly=True)["flip_hdr"] for k in (1.1, 2.0))
    assert 0 < small < large < 1


def test_flicker_ignores_a_standing_error_and_sees_an_alternating_one() -> None:
    unit = 1 / 255
    # On linear-in-luma greys a standing offset of luma leaves no change; ± one step of luma alternating changes by 2 a frame.
    decode = lambda v: ((v + 0.055) / 1.055) ** 2.4  # noqa: E731
    greys = [np.full(SHAPE, decode(0.3 + 0.1 * k)) for k in range(4)]
    standing = [Pair(np.full(SHAPE, decode(0.3 + 0.1 * k + unit)), grey) for k, grey in enumerate(greys)]
    moving = [Pair(np.full(SHAPE, decode(0.3 + 0.1 * k + unit * (-1) ** k)), grey) for k, grey in enumerate(greys)]
    assert [flicker(*two) for two in pairwise(standing)] == pytest.approx([0] * 3, abs=1e-9)
    assert [flicker(*two) for two in pairwise(moving)] == pytest.approx([2] * 3, rel=1e-9)
    changes = [measure_change(*two) for two in pairwise(moving)]
    assert [change["flicker"] for change in changes] == [flicker(*two) for two in pairwise(moving)]


def test_equal_sequences_flicker_by_exactly_nothing() -> None:
    images = [two_images()[k] for k in (0, 1, 0)]
    assert [measure_change(Pair(a, a), Pair(b, b)) for a, b in pairwise(images)] == [{"flicker": 0, "flicker_linear": 0}] * 2


def test_linear_flicker_is_relative_to_the_references() -> None:
    grey, bright = np.full(SHAPE, 0.5), np.full(SHAPE, 1.5)
    # Errors 0.1 and −0.1 around references of mean luminance 0.5 and 1.5: a change of 0.2 over a mean of 1.
    assert flicker_linear(Pair(grey + 0.1, grey), Pair(bright - 0.1, bright)) == pytest.approx(0.2)
    black = np.zeros(SHAPE)
    assert flicker_linear(Pair(black, black), Pair(black, black)) == 0
    assert flicker_linear(Pair(black, black), Pair(grey, black)) is None


def test_flicker_of_the_references_noise_alone() -> None:
    reference = np.full((64, 64, 3), 0.5, np.float32)
    noisy = Noise(reference, np.full_like(reference, 0.005**2))
    slope = 255 * 1.055 / 2.4 * 0.5 ** (1 / 2.4 - 1)
    # The difference of two independent draws of σ has the mean size σ·2/sqrt(π). Over 4096 pixels its relative standard deviation
    # is sqrt(π/2 − 1)/64 = 1.2 %: 5 % is over 4 of them.
    assert flicker_floor(noisy, noisy)["flicker"] == pytest.approx(0.005 * slope * 2 / np.sqrt(np.pi), rel=0.05)
    exact = Noise(reference, np.zeros_like(reference))
    assert flicker_floor(exact, exact) == {"flicker": 0, "flicker_linear": 0}


def test_noise_that_stays_from_frame_to_frame_makes_no_flicker() -> None:
    reference = np.full((64, 64, 3), 0.5, np.float32)
    error = 0.005 * np.random.default_rng(3).standard_normal(reference.shape).astype(np.float32)
    noises = [Noise(reference, np.full_like(reference, 0.005**2), sample) for sample in (error, error, -error)]
    assert flicker_floor(*noises[:2]) == {"flicker": 0, "flicker_linear": 0}
    moved = display_values(np.maximum(reference + error, 0), 1.0) - display_values(np.maximum(reference - error, 0), 1.0)
    assert flicker_floor(*noises[1:])["flicker"] == pytest.approx(np.abs(moved @ LUMA).mean(), rel=1e-6)


def test_residuals_keep_their_sign_and_ghosts_their_place() -> None:
    reference = np.full(SHAPE, 0.5, np.float32)
    test = reference.copy()
    test[:, :2] = 0.6
    test[:, -1] = 0.3
    revealed = np.zeros(SHAPE[:2], bool)
    revealed[:, 0] = revealed[:, -1] = True
    row = measure(Pair(test, reference, revealed=revealed))
    level = lambda value: float(display_values(np.float64([value]), 1.0)[0])  # noqa: E731
    bright, dark = level(0.6) - level(0.5), level(0.5) - level(0.3)
    assert row["too_bright"] == pytest.approx(bright * 2 / SHAPE[1], rel=1e-6)
    assert row["too_dark"] == pytest.approx(dark / SHAPE[1], rel=1e-6)
    assert row["ghost_bright"] == pytest.approx(bright / 2, rel=1e-6)
    assert row["ghost_dark"] == pytest.approx(dark / 2, rel=1e-6)
    assert measure(Pair(test, reference))["ghost_bright"] is None
    assert measure(Pair(test, reference, revealed=np.zeros(SHAPE[:2], bool)))["ghost_dark"] is None
    with pytest.raises(ValueError, match="revealed"):
        Pair(test, reference, revealed=revealed[:2])


def test_noise_floor_is_the_size_of_the_noise() -> None:
    reference = np.full((64, 64, 3), 0.5, np.float32)
    row = noise_floor(reference, np.full_like(reference, 0.005**2))
    slope = 255 * 1.055 / 2.4 * 0.5 ** (1 / 2.4 - 1)
    # One draw at 4096 pixels: the root mean square of the noise has a relative standard deviation of 1/sqrt(2·4096) = 1.1 %; 5 %
    # is over 4 of them.
    assert row["rmse"] == pytest.approx(0.005 * slope, rel=0.05)
    assert row == noise_floor(reference, np.full_like(reference, 0.005**2))
    assert noise_floor(reference, np.zeros_like(reference))["rmse"] == 0


def test_signed_relative_error_keeps_the_sign() -> None:
    reference = np.full(SHAPE, 2.0, np.float32)
    brighter = signed_relative_error(Pair(reference * np.float32(1.5), reference))
    assert brighter == pytest.approx(np.full(SHAPE[:2], 0.5 / 1.01), rel=1e-6)
    assert signed_relative_error(Pair(reference * np.float32(0.5), reference)).max() < 0


def test_registry_is_complete_and_its_page_is_fresh() -> None:
    row = compare(*two_images(), nightly=True)
    assert set(row) | set(measure_change(Pair(*two_images()), Pair(*two_images()))) == set(METRICS)
    assert all((m.function is None) != (m.change is None) for m in METRICS.values())
    assert all(m.formula and m.source and m.unit in ("0-255", "1", "share") for m in METRICS.values())
    assert METRICS["ssim"].badness(0.9) < METRICS["ssim"].badness(0.8)
    assert METRICS["mean_bias"].badness(-0.1) < METRICS["mean_bias"].badness(0.2)
    written = Path(__file__).parents[3] / "docs" / "metrics" / "README.md"
    assert written.read_text() == page()
