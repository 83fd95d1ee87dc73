"""The claims about temporal caching: how runs are compared with their truth, without the long renders."""

import numpy as np
import pytest

import renderers
from jobs.claims.registry import registered_claims
from jobs.claims.trc_runs import Ask, Truth, accuracy, accuracy_lost, frame_errors, root_mean, runs_of, squares, truth_of
from jobs.claims.trc_tables import CASES

SIZE = (24, 18)


def truth_with(frames: tuple[int, ...]) -> Truth:
    """Light of mean 2; the left half of the picture was revealed, but not in the first frame."""
    shape = len(frames), 6, 8
    revealed = np.zeros(shape, bool)
    revealed[1:, :, :4] = True
    return Truth(frames, np.full((2, *shape, 3), 2.0), np.zeros((*shape, 3)), revealed, np.zeros(shape, np.int32))


def test_the_claims_are_registered_and_their_scenes_exist() -> None:
    assert {"trc-table-5.1", "trc-table-5.2", "trc-fig-5.10", "trc-memory"} <= set(registered_claims())
    assert set(CASES) <= set(renderers.builtin_scenes())
    assert all(0 <= case.frames[0] < case.frames[1] < case.whole for case in CASES.values())


def test_an_error_that_stays_does_not_flicker() -> None:
    truth = truth_with((3, 4, 5))
    found = frame_errors(truth.indirect * 1.25, truth)
    np.testing.assert_allclose(found.rmse, 0.25)
    assert np.isnan(found.flicker[0])
    assert (found.flicker[1:] == 0).all()
    assert (found.jump[1:] == 0).all()


def test_errors_that_change_are_seen_between_consecutive_frames_only() -> None:
    """Frame 9 has no frame before it. A step of 0.5 in all of frame 4, and back in one pixel of frame 5, in units of the mean 2."""
    truth = truth_with((3, 4, 5, 9))
    test = truth.indirect.copy()
    test[1] += 0.5
    test[2] = test[1]
    test[2, 0, 0] -= 0.5
    found = frame_errors(test, truth)
    np.testing.assert_allclose(found.flicker[1:3], [0.25, 0.25 / np.sqrt(48)])
    np.testing.assert_allclose(found.jump[1:3], 0.25)
    assert np.isnan(found.flicker[[0, 3]]).all()
    assert root_mean(found.change) == pytest.approx(0.25 * np.sqrt((1 + 1 / 48) / 2))


def test_pixels_that_see_another_object_than_before_do_not_flicker() -> None:
    truth = truth_with((3, 4, 5))
    truth.seen[1:, 2, 3] = 7
    test = truth.indirect.copy()
    test[1:, 2, 3] += 4
    test[2, 5, 7] += 0.5
    found = frame_errors(test, truth)
    assert found.flicker[1] == found.jump[1] == 0
    np.testing.assert_allclose([found.flicker[2], found.jump[2]], [0.25 / np.sqrt(48), 0.25])


def test_ghosts_are_signed_and_looked_for_where_something_was_hidden() -> None:
    truth = truth_with((3, 4))
    test = truth.indirect.copy()
    test[:, :, :4] -= 0.4
    test[:, :, 4:] += 1.0
    found = frame_errors(test, truth)
    assert np.isnan(found.ghost[0])
    assert found.ghost[1] == pytest.approx(-0.2)


def test_noise_of_the_truth_is_no_error() -> None:
    """Light of 2 that is off by 0.3, and by 0.1 more in the second frame, against halves of noise 1 and 0.5.

    (e - n₁)(e - n₂) has the variance e²(σ₁² + σ₂²) + σ₁²σ₂² at each of N values of a frame; so have their changes, of independent
    noise, with e = 0.1 and twice the variances. Bounds: four standard errors, kept by a right one in all but 1 of 16,000 draws.
    Against the mean of both halves alone, squared errors are too large by its variance, (σ₁² + σ₂²) / 4 = 0.31, over three times
    what there is to be found.
    """
    size, (s1, s2), rng = (2, 120, 160, 3), (1.0, 0.5), np.random.default_rng(3)
    shape = size[:3]
    halves = 2 + np.array([rng.normal(0, s, size) for s in (s1, s2)])
    truth = Truth((0, 1), halves, np.zeros(size), np.zeros(shape, bool), np.zeros(shape, np.int32))
    indirect = np.full(size, 2.3)
    indirect[1] += 0.1
    found, unit, count = frame_errors(indirect, truth), truth.indirect.mean() ** 2, indirect[0].size
    for measured, error, v1, v2 in (
        (found.error[0], 0.3, s1**2, s2**2),
        (found.error[1], 0.4, s1**2, s2**2),
        (found.change[1], 0.1, 2 * s1**2, 2 * s2**2),
    ):
        allowed = 4 * np.sqrt((error**2 * (v1 + v2) + v1 * v2) / count)
        assert abs(measured * unit - error**2) < allowed
    noise = (s1**2 + s2**2) / 4
    assert np.mean((indirect[0] - truth.indirect[0]) ** 2) > 0.3**2 + 0.9 * noise
    assert truth.noise == pytest.approx(np.sqrt(noise) / 2, rel=0.02)


def test_products_of_both_halves_are_squares_less_the_variance_of_their_mean() -> None:
    rng = np.random.default_rng(5)
    found, halves = rng.random((4, 3)), rng.random((2, 4, 3))
    expected = (found - halves.mean(axis=0)) ** 2 - (halves[0] - halves[1]) ** 2 / 4
    np.testing.assert_allclose(squares(found, halves), expected, atol=1e-15)


def test_squares_below_zero_are_averaged_before_the_root() -> None:
    """A frame without error may come out below 0: left out of the mean, or taken for 0, it would raise the others'."""
    assert root_mean(np.array([0.05, -0.01, np.nan])) == pytest.approx(np.sqrt(0.02))
    assert root_mean(np.array([-0.01, np.nan])) == 0


def test_the_accuracy_that_noise_hides_is_bounded() -> None:
    """Light of 1 + e, e = 0.02 or 0, against halves of noise 0.03, whose mean has s = 0.0212: |e - n| / (1 + n), not |e|.

    For normal noise its mean is off by 2 s φ(e/s) - 2 e Φ(-e/s), in second order by s² (2Φ(e/s) - 1): 0.394 + 0.029 and 1.693 %.
    Four standard errors of 57,600 values of deviations up to 0.03 are 0.05 %; of the bound, 1/0.41 times a difference, 0.12 %.
    """
    shape, rng = (1, 120, 160, 3), np.random.default_rng(7)
    halves = 1 + rng.normal(0, 0.03, (2, *shape))
    truth = Truth((0,), halves, np.zeros(shape), np.zeros(shape[:3], bool), np.zeros(shape[:3], np.int32))
    for error, hidden in ((0.02, 0.423), (0.0, 1.693)):
        indirect = np.full(shape, 1 + error)
        missing = 100 * (1 - error) - accuracy(indirect, truth.indirect)[0]
        assert missing == pytest.approx(hidden, abs=0.05)
        assert accuracy_lost(indirect, truth)[0] > missing - 0.12


def test_nothing_to_average_is_no_number() -> None:
    assert np.isnan(root_mean(np.array([np.nan])))


def test_runs_that_take_turns_are_those_of_each_method_alone() -> None:
    """Pictures of the truth's frames to the bit; of path tracing what is left without direct light; counts of all frames."""
    scene = renderers.load_scene("cube-in-a-box")
    truth = truth_of(scene, SIZE, (1, 2), rays=64)
    values = {"a": 0.4, "rays": 64}
    asks = {"kept": Ask("trc", values), "paths": Ask("pt", {"transport": "one-bounce", "spp": 4})}
    runs = runs_of(scene, asks, SIZE, (0, 3), truth)
    trc, pt = renderers.get_method("trc"), renderers.get_method("pt")
    alone = list(trc.render_frames(scene, trc.Settings(**values), size=SIZE, frames=(0, 3)))
    assert (runs["kept"].indirect == [alone[k].layers["indirect"] for k in (1, 2)]).all()
    assert runs["kept"].records.tolist() == [f.counters["records"] for f in alone]
    assert len(runs["kept"].cpu) == 4
    traced = pt.render(scene, pt.Settings(**asks["paths"].values), size=SIZE, frame=2).layers["beauty"]
    np.testing.assert_allclose(runs["paths"].indirect[1], traced - truth.direct[1], atol=1e-6)
    shown = alone[2].layers["direct"]
    np.testing.assert_allclose(shown, truth.direct[1], atol=1e-6)


def test_the_truth_has_the_energy_that_path_tracing_finds() -> None:
    """Its 2 × 32 rays are within 30 % a pixel, free of bias, independent: 0.3 / √432 = 1.5 % of the mean; three standard errors."""
    scene = renderers.load_scene("cube-in-a-box")
    truth = truth_of(scene, SIZE, (2,), rays=32)
    asks = {"paths": Ask("pt", {"transport": "one-bounce", "spp": 256})}
    traced = runs_of(scene, asks, SIZE, (2, 2), truth)["paths"].indirect
    assert traced.mean() == pytest.approx(truth.indirect.mean(), rel=0.045)


def test_a_run_without_truth_keeps_times_and_counts() -> None:
    scene = renderers.load_scene("cube-in-a-box")
    (run,) = runs_of(scene, {"a": Ask("trc", {"a": 0.4, "rays": 64})}, SIZE, (0, 1), Truth.none(SIZE)).values()
    assert run.indirect.shape == (0, 18, 24, 3)
    assert (run.records > 0).any()
    assert run.alive.shape == (2,)
