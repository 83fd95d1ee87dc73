"""Lives by the error of chords: closed forms, and the toy with exact light."""

import numpy as np
import pytest
from numpy.typing import NDArray
from temporal_toy import run

from renderers.transport.caching.records import Records, Sites
from renderers.transport.temporal.chords import CHORD, chord_lifespan, curvature, first_of_a_place, lengthened
from renderers.transport.temporal.records import Timed
from renderers.transport.temporal.trends import Trends

ONE = np.ones(1, np.int64)
YES, NO = np.ones(1, bool), np.zeros(1, bool)


@pytest.mark.parametrize(("before", "frames"), [(3, 7), (20, 1), (5, 5)])
def test_divided_differences_know_parabolas_whatever_the_stretches(before: int, frames: int) -> None:
    bend = np.array([0.3, -0.7, 0.1])
    light = lambda t: 2 + 0.4 * t + bend / 2 * t**2  # noqa: E731
    now = light(0.0)
    slope, ahead = ((now - light(-frames)) / frames)[None], (light(1.0) - now)[None]
    earlier = ((light(-frames) - light(-frames - before)) / before)[None]
    seen_first = (light(-frames + 1.0) - light(-frames))[None]
    for past, span, foreseen in ((earlier, before, NO), (0 * earlier, 0, YES), (earlier, before, YES), (seen_first, -1, YES)):
        found = curvature(past, span * ONE, slope, frames * ONE, ahead, foreseen)
        assert found == pytest.approx(0.7, rel=1e-9)
    if frames > 1:
        assert curvature(seen_first, -ONE, slope, frames * ONE, ahead, NO) == pytest.approx(0.7, rel=1e-9)
    unknown = curvature(seen_first, -ONE, slope, ONE, ahead, NO)
    assert np.isinf(unknown), "a frame foreseen and then computed says nothing about a second difference"


def test_an_event_that_is_foreseen_counts_although_the_past_is_a_straight_line() -> None:
    slope = np.array([[0.1]])
    bend = curvature(slope, 10 * ONE, slope, 10 * ONE, np.array([[-1.0]]), YES)
    assert bend == pytest.approx(2 * 1.1 / 11)
    assert chord_lifespan(bend, 0.0125, 20) == 1


def test_chords_are_off_by_no_more_than_asked_and_would_be_a_frame_later() -> None:
    random = np.random.default_rng(3)
    bend, error = 10 ** random.uniform(-6, 0, 5000), 0.0125
    life = chord_lifespan(bend, error, 20)
    off = bend * life**2 / 8
    assert (off <= error * (1 + 1e-6))[life > 1].all()
    assert (bend * (life + 1) ** 2 / 8 > error)[life < 20].all()
    assert len(np.unique(life)) == 20
    assert chord_lifespan(np.array([0.0, np.inf]), error, 20).tolist() == [20, 1]


def successor(first: NDArray[np.float64], now: NDArray[np.float64], later: NDArray[np.float64], least: float) -> int:
    """Life of a successor after one frame of another, whose life by the rate is one frame; δ_max = 20, a_t = 0.05. Light: (n, 3)
    coefficients, or (3,) irradiance."""
    zero, three, none = np.zeros((1, 3, 3)), np.zeros((1, 3)), np.zeros(1, np.int64)

    def records(light: NDArray[np.float64]) -> Records:
        irradiance, carried = (light[None], None) if light.ndim == 1 else (three, light[None])
        slopes = None if carried is None else np.zeros((1, 2, *light.shape))
        return Records(three, three, np.ones(1), irradiance, zero, zero, carried, slopes)

    old, new = (
        Timed.of(records(light), Trends.none(1), Sites(three, three, three), none, frame, none + 1, none, none)
        for frame, light in ((0, first), (1, now))
    )
    old = first_of_a_place(old, old.records, old.records, NO)
    return int(lengthened(new, old, records(now), records(later), YES, least, 0.05, 20).life[0])


def test_chords_of_what_nobody_sees_are_as_long_as_may_be() -> None:
    """Light bends by all of itself, but is a thousandth of E_min: twice the life before. Were it E_min itself, one frame."""
    light = [np.full(3, value) for value in (1e-6, 2e-6, 1e-6)]
    assert successor(*light, least=1e-3) == 2
    assert successor(*(1000 * value for value in light), least=1e-3) == 1


def test_chords_of_radiance_go_by_norms() -> None:
    """One coefficient holds the light, 48 bend by b each: so that |λ''| / |λ| = √48 b, and chords of two frames are allowed
    while √(8 · 0.0125 / (√48 b)) ≥ 2."""
    for bend, life in ((0.025 / np.sqrt(48) * 0.99, 2), (0.025 / np.sqrt(48) * 1.01, 1)):
        now = np.zeros((16, 3))
        now[0] = 1 / np.sqrt(3)
        # the slope before is 0, the one foreseen is b
        assert successor(now, now, now + bend, least=1e-6) == life


def test_under_a_moving_light_chords_need_fewer_records_and_err_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    rate, chord = (run(monkeypatch, "interpolated", 60, v=1, curved=curved) for curved in (False, True))
    assert chord.total("records") < 0.7 * rate.total("records")
    # what chords may add at their worst, in squares, to the error that interpolation in space leaves
    assert chord.rmse <= np.hypot(rate.rmse, CHORD * 0.05)
    assert chord.flicker < 1.25 * rate.flicker
