"""The claims about temporal caching: how runs are compared with their truth, without the long renders."""

import numpy as np
import pytest

import renderers
from jobs.claims.registry import registered_claims
from jobs.claims.trc_runs import Ask, Truth, frame_errors, over_all, runs_of, truth_of
from jobs.claims.trc_tables import CASES

SIZE = (24, 18)


def truth_with(frames: tuple[int, ...]) -> Truth:
    """Light of mean 2; the left half of the picture was revealed, but not in the first frame."""
    shape = len(frames), 6, 8
    revealed = np.zeros(shape, bool)
    revealed[1:, :, :4] = True
    return Truth(frames, np.full((*shape, 3), 2.0), np.zeros((*shape, 3)), revealed, np.zeros(shape, np.int32))


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
    assert over_all(found.flicker) == pytest.approx(0.25 * np.sqrt((1 + 1 / 48) / 2))


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


def test_nothing_to_average_is_no_number() -> None:
    assert np.isnan(over_all(np.array([np.nan])))


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
    """Its 64 rays are within 30 % at a pixel, unbiased and independent: 0.3 / √432 = 1.5 % of the mean; three standard errors."""
    scene = renderers.load_scene("cube-in-a-box")
    truth = truth_of(scene, SIZE, (2,), rays=64)
    asks = {"paths": Ask("pt", {"transport": "one-bounce", "spp": 256})}
    traced = runs_of(scene, asks, SIZE, (2, 2), truth)["paths"].indirect
    assert traced.mean() == pytest.approx(truth.indirect.mean(), rel=0.045)


def test_a_run_without_truth_keeps_times_and_counts() -> None:
    scene = renderers.load_scene("cube-in-a-box")
    (run,) = runs_of(scene, {"a": Ask("trc", {"a": 0.4, "rays": 64})}, SIZE, (0, 1), Truth.none(SIZE)).values()
    assert run.indirect.shape == (0, 18, 24, 3)
    assert (run.records > 0).any()
    assert run.alive.shape == (2,)
