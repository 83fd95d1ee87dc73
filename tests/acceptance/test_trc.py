"""Temporal radiance caching against the specification's checks (A…): lifespans, frames, the cache over time."""

from itertools import pairwise

import numpy as np
import pytest
from temporal_frames import (
    COARSE,
    METHOD,
    MODES,
    SIZE,
    assert_any_number_of_threads,
    assert_beginnings_agree,
    assert_computed_once,
    bytes_of,
    frames_of,
    total,
)  # fmt: skip
from temporal_rooms import room, slow_cube

from renderers import get_method, load_scene
from renderers.methods.trc import TrcSettings
from renderers.transport.temporal.lifespan import darkness, irradiance_rate, lifespan, radiance_rate, staggered

pytestmark = pytest.mark.usefixtures("software_device")


def test_a1_closed_form_lifespan_is_the_longest_admitted() -> None:
    rng = np.random.default_rng(0)
    count = 20_000
    rate = np.where(rng.random(count) < 0.05, 0.0, 10 ** rng.uniform(-5, 1, count))
    a_t, longest = 10 ** rng.uniform(-3, 0, count), rng.integers(1, 60, count)
    closed = np.array([lifespan(rate[i : i + 1], a_t[i], int(longest[i]))[0] for i in range(count)])
    lag = np.arange(60)
    admitted = (rate[:, None] * lag <= a_t[:, None]) & (lag < longest[:, None])
    brute = np.argmin(np.concatenate([admitted, np.zeros((count, 1), bool)], axis=1), axis=1)
    np.testing.assert_array_equal(closed, brute)


def test_a2_h15_ties_count_as_admitted() -> None:
    one = np.full((1, 3), 1.0)
    rates = np.concatenate([irradiance_rate(one, one * tau, 1e-9) for tau in (1.01, 1.05, 0.99, 0.95)])
    np.testing.assert_array_equal(lifespan(rates, 0.05, 20), [6, 2, 6, 2])


def test_table_of_lifespans() -> None:
    rates = np.array([0.001, 0.0025, 0.005, 0.01, 0.02, 0.025, 0.05, 0.06])
    for longest, expected in ((20, [20, 20, 11, 6, 3, 3, 2, 1]), (5, [5, 5, 5, 5, 3, 3, 2, 1]), (1, [1] * 8)):
        np.testing.assert_array_equal(lifespan(rates, 0.05, longest), expected)


def test_a3_a_frozen_record_drifts_by_at_most_a_t_under_linear_light() -> None:
    rate = np.random.default_rng(1).uniform(1e-4, 0.1, 1000)
    drift = rate * (lifespan(rate, 0.05, 1000) - 1)
    assert drift.max() <= 0.05 * (1 + 1e-8)


def test_a4_brightening_and_fading_live_equally_long() -> None:
    now = np.random.default_rng(2).uniform(0.1, 5, (100, 3))
    for change in (0.003, 0.01, 0.2):
        up, down = (lifespan(irradiance_rate(now, now * factor, 1e-6), 0.05, 20) for factor in (1 + change, 1 - change))
        np.testing.assert_array_equal(up, down)


def test_h1_black_records() -> None:
    """Black and staying black: the longest life; about to be lit: one frame."""
    black, lit = np.zeros((1, 3)), np.full((1, 3), 0.5)
    least = darkness(np.concatenate([black, lit]))
    assert lifespan(irradiance_rate(black, black, least), 0.05, 20) == 20
    assert lifespan(irradiance_rate(black, lit, least), 0.05, 20) == 1
    assert darkness(black) > 0


def test_the_channel_that_changes_most_counts_against_the_brightest() -> None:
    """|τ - 1| of coloured light is max|E_1 - E_0| / max E_0, whichever channels these are; what is darker than
    E_min counts as E_min."""
    now = np.array([[1.0, 0.5, 0.1], [0.2, 2.0, 0.0], [0.3, 0.3, 3.0], [2e-6, 1e-6, 0.0]])
    later = np.array([[1.01, 0.5, 0.3], [0.25, 2.0, 0.1], [0.0, 0.2, 3.0], [0.0, 1e-6, 0.0]])
    np.testing.assert_allclose(irradiance_rate(now, later, 1e-4), [0.2, 0.05, 0.1, 0.02])


def test_radiance_rate_is_not_fooled_as_the_printed_one_is() -> None:
    """Three counter-examples to max λ1/λ0: most coefficients halve; a small one changes sign; a tiny one grows fifty times."""
    now = np.array([[1.0, 0.8, 0.6, 0.02], [1.0, 0.8, 0.6, 0.02], [1.0, 0.8, 0.6, 1e-9]])
    later = np.array([[1.0, 0.4, 0.3, 0.01], [1.0, 0.8, 0.6, -0.02], [1.0, 0.8, 0.6, 50e-9]])
    rate = radiance_rate(now, later, 1e-6)
    assert rate[0] == pytest.approx(0.5)
    assert rate[1] == pytest.approx(2.0)
    assert rate[2] < 1e-6
    np.testing.assert_allclose(radiance_rate(now, now * 1.03, 1e-6), 0.03, rtol=1e-6)


def test_staggered_first_lives_are_spread_evenly() -> None:
    life = staggered(np.full(400, 20), np.arange(400), 20)
    counts = np.bincount(life, minlength=21)[1:]
    assert counts.min() >= 17
    assert counts.max() <= 23


@pytest.mark.parametrize(("placement", "meant"), [("auto", "hessian-bounded"), ("bounded", "bounded")])
def test_cache_per_frame_is_radiance_cache_splatting(placement: str, meant: str) -> None:
    scene, rcs = slow_cube(), get_method("rcs")
    for k, frame in enumerate(frames_of(scene, 3, cache="per-frame", placement=placement)):
        plain = rcs.render(scene, rcs.Settings(placement=meant, **COARSE), size=SIZE, frame=k)
        assert bytes_of(frame) == bytes_of(plain)
        assert frame.counters["records"] == plain.counters["records"]


@MODES
def test_a_frame_does_not_depend_on_the_end_of_its_range(mode: str) -> None:
    assert_beginnings_agree(slow_cube(), 7, 3, (1, 4), gradients_in_time=mode, delta_max=5)


def test_a18_the_records_are_the_same_in_all_modes() -> None:
    counted = []
    for mode in ("none", "extrapolated", "interpolated"):
        names = ("records_new", "records_renewed", "records_deleted", "records_alive")
        counted.append([[f.counters[n] for n in names] for f in frames_of(slow_cube(), 8, gradients_in_time=mode)])
    assert counted[0] == counted[1] == counted[2]


def test_a_still_scene_is_computed_once_and_gives_the_same_bytes() -> None:
    for scene in (room(), load_scene("cornell-box")):
        assert_computed_once(scene)


def test_a22_a_life_of_one_frame_computes_every_place_in_every_frame() -> None:
    frames = frames_of(slow_cube(), 4, delta_max=1)
    for before, after in pairwise(frames):
        c = after.counters
        assert c["records"] == c["records_renewed"] + c["records_new"] == c["records_alive"]
        assert c["records_renewed"] + c["records_deleted"] == before.counters["records_alive"]
        assert c["predictions"] == 0


@pytest.mark.parametrize("quantity", ["delta_max", "a_t"])
def test_a23_a24_longer_lives_need_fewer_records(quantity: str) -> None:
    values = (1, 2, 5, 10) if quantity == "delta_max" else (0.001, 0.01, 0.2)
    totals = [total(frames_of(slow_cube(), 12, **{quantity: v}, stagger=False), "records") for v in values]
    assert all(a >= b for a, b in pairwise(totals)), totals
    assert totals[0] > 1.5 * totals[-1]


def test_a29_no_pixel_is_left_without_a_record() -> None:
    assert all(f.counters["pixels_missed"] == 0 for f in frames_of(slow_cube(), 4))


def test_a28_light_is_that_of_path_tracing() -> None:
    """A closed diffuse room with a block: direct light by 10⁻³ at all pixels, one bounce (path of depth 3 less that of depth 2) by
    1 % in the mean. Path tracing's own noise in the mean is 0.02 / √768 = 0.07 %."""
    from renderers.reference.replicates import render

    scene, size = room(), (32, 24)
    frame = METHOD.render(scene, TrcSettings(rays=1024, a=0.1), size=size)
    once, twice = (render(scene, transport, size, noise=0.02).image for transport in ("direct", "one-bounce"))
    direct, indirect = frame.layers["direct"], frame.layers["indirect"]
    assert np.abs(direct - once).max() <= 1e-3 * once.mean()
    assert indirect.mean(dtype=np.float64) == pytest.approx((twice - once).mean(dtype=np.float64), rel=0.01)


def test_same_bytes_at_any_thread_count() -> None:
    assert_any_number_of_threads(slow_cube())
