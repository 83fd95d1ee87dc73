"""Temporal caching with exactly known light: the specification's toy (A10, A17, A20 to A25, H2, H3, H13, H14)."""

from collections.abc import Iterator
from itertools import pairwise

import numba
import numpy as np
import pytest
from temporal_toy import Lamps, normals, run

from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.temporal.trends import Trends

MODES = ("none", "extrapolated", "interpolated")
PAN = 0.01


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Kernels of 1600 pixels and few records: other threads would only spin."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(threads)


def test_a10_trends_of_translation_gradients_are_gradients_of_trends() -> None:
    """Mixed partial derivatives agree: ∂/∂t ∇_p E = ∇_p ∂E/∂t."""
    rng, h = np.random.default_rng(0), 1e-3
    position = np.concatenate([rng.uniform(-0.9, 0.9, (40, 2)), np.zeros((40, 1))], axis=1)
    normal = normals(position)

    def sites(shift: np.ndarray) -> Sites:
        return Sites(position + shift, normal, normal)

    def trends(shift: np.ndarray) -> Trends:
        first, last = (Lamps(10 + s * h, 1.0).records(sites(shift)) for s in (-1, 1))
        return Trends.between(first, last, np.full(40, 2 * h))

    of_gradient = trends(np.zeros(3)).translation[:, 0, :2]
    gradient_of = np.stack([(trends(h * e).irradiance - trends(-h * e).irradiance)[:, 0] / (2 * h) for e in np.eye(3)[:2]], axis=1)
    assert np.abs(of_gradient - gradient_of).max() <= 1e-5 * np.abs(of_gradient).max()


def test_a17_five_hundred_signed_terms_in_single_precision() -> None:
    rng, count = np.random.default_rng(1), 500
    point, up = np.zeros((1, 3)), np.array([[0.0, 0, 1]])
    position = np.concatenate([rng.uniform(-0.05, 0.05, (count, 2)), np.zeros((count, 1))], axis=1)
    gradient = rng.normal(size=(count, 3, 3)) * 5
    records = Records(position, np.repeat(up, count, 0), np.ones(count), rng.random((count, 3)) + 1, gradient, gradient)
    values = []
    for dtype in (np.float32, np.float64):
        canvas = Canvas(np.zeros(1, np.intp), 1, point, up, dtype)
        canvas.add(records, 0.4)
        values.append(canvas.irradiance[0].astype(np.float64))
    np.testing.assert_allclose(values[0], values[1], rtol=1e-5)


def test_a20_accuracy_over_a_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """All records are made in frame 0 and renewed in frame 20."""
    steps, worst = {}, {}
    for mode in MODES:
        percent = run(monkeypatch, mode, 24, a_t=10.0).accuracy
        steps[mode], worst[mode] = abs(percent[20] - percent[19]), percent.min()
    assert steps["none"] > 10 * steps["interpolated"]
    assert steps["none"] > steps["extrapolated"] > steps["interpolated"]
    assert worst["interpolated"] >= 98


def test_a21_h14_flicker_before_a_moving_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """Interpolated ≤ extrapolated < none < per-frame, with records placed in the order of the scan, as specified.

    (Records spread like blue noise, in an order that is the same in every frame, keep their places from frame to frame even in a
    cache of each frame: that flickers by 1.0 % here, less than without trends, 1.3 %.) What pops in with the view does so in all
    modes alike.
    """
    films = {mode: run(monkeypatch, mode, 30, pan=PAN, order="sequential") for mode in MODES}
    plain = run(monkeypatch, "none", 30, pan=PAN, order="sequential", keeping="per-frame")
    flicker = [films[mode].flicker for mode in ("interpolated", "extrapolated", "none")]
    assert flicker[0] <= flicker[1] < flicker[2] < plain.flicker
    assert all(film.total("records_new") == films["none"].total("records_new") for film in films.values())
    jumps = [np.abs(np.diff(film.error, axis=0)).max() for film in films.values()]
    assert max(jumps) < np.abs(np.diff(plain.error, axis=0)).max()


@pytest.mark.parametrize("quantity", ["longest", "a_t"])
def test_a23_a24_records_fall_with_longer_lives(monkeypatch: pytest.MonkeyPatch, quantity: str) -> None:
    values = (1, 2, 5, 10, 20, 40) if quantity == "longest" else (0.01, 0.02, 0.05, 0.1, 0.2)
    totals = [run(monkeypatch, "none", 60, **{quantity: value}).total("records") for value in values]
    assert all(a > b for a, b in pairwise(totals)), totals


def test_a25_light_at_rest_before_a_moving_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lives are full, and all modes give the same pictures."""
    films = [run(monkeypatch, mode, 30, v=0, pan=PAN, longest=5) for mode in MODES]
    for film in films[1:]:
        np.testing.assert_allclose(film.images, films[0].images, rtol=1e-6)
    for records in films[0].records:
        assert (records.life == 5).all()


def test_h2_turning_points_need_a_longest_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light that swings with a period of 125 frames: frozen records are granted full lives at its extrema."""
    errors = [run(monkeypatch, "none", 126, v=1, pan=PAN, longest=longest).rmse for longest in (20, 10, 5)]
    assert errors[0] > errors[1] > errors[2]


def test_h3_extrapolation_overshoots_fast_light_unless_lives_are_short(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {}
    for longest in (20, 2):
        films = {mode: run(monkeypatch, mode, 60, v=6, a_t=10.0, longest=longest) for mode in MODES}
        assert all((film.images >= 0).all() for film in films.values())
        errors[longest] = {mode: film.rmse for mode, film in films.items()}
    assert errors[20]["extrapolated"] > errors[20]["none"] > errors[20]["interpolated"]
    assert errors[2]["extrapolated"] < errors[2]["none"]


def test_h13_interpolated_records_hand_over_without_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """At its place a record arrives at its successor's value: within 0.1 %, wherever none of its channels was clamped."""
    film = run(monkeypatch, "interpolated", 40)
    checked = 0
    for t, (before, after) in enumerate(pairwise(film.records)):
        renewed = after.rows((after.born == t + 1) & np.isin(after.place, before.place))
        old = before.rows(np.isin(before.place, renewed.place) & (before.life > 1))
        renewed = renewed.rows(np.isin(renewed.place, old.place))
        np.testing.assert_allclose(old.at(t + 1).irradiance, renewed.records.irradiance, rtol=1e-3)
        checked += len(old)
    assert checked > 100
