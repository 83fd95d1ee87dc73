"""What a comparison of two evaluation folders sees, and what it must not see."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from nightly_folders import change_counters, change_images, copy, fail, redraw
from report_evaluation import METHODS, make

from renderers.images import read_exr, write_exr
from reports.change import Comparison, RowChange
from reports.folder import read
from reports.regression import compare

SEEDS = 6
FLAGS = {"regression", "improvement", "undecided", "failed"}
PT = next(k for k, m in enumerate(METHODS) if m[0] == "pt")


@pytest.fixture(scope="module")
def accepted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("accepted"), methods=PT + 1, seeds=SEEDS)


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("few"), methods=3, seeds=SEEDS)


def row(comparison: Comparison, label: str) -> RowChange:
    return next(r for r in comparison.rows if r.label == label)


def flags(comparison: Comparison) -> dict[str, str]:
    return {r.label: r.verdict for r in comparison.rows if r.verdict in FLAGS}


def test_ten_repeats_with_the_same_bytes_are_unchanged(few: Path, tmp_path: Path) -> None:
    for k in range(10):
        again = compare(few, make(tmp_path / str(k), methods=3, seeds=SEEDS))
        assert again.counts == {"unchanged": 3}
        assert again.tests == 0
        assert not again.regressed


def test_ten_repeats_with_other_random_numbers_raise_no_flag(few: Path, tmp_path: Path) -> None:
    for k in range(10):
        folder = copy(few, tmp_path / str(k))
        redraw(folder, seed=100 + k)
        again = compare(few, folder)
        assert flags(again) == {}
        assert again.counts == {"changed-within-noise": 3}
        assert again.tests == 9  # RMSE, SSIM and bias of every row; equal work counts need no test


@pytest.mark.parametrize("index", [PT, 3], ids=["pt", "rcs"])
def test_three_per_cent_more_energy_is_a_regression(accepted: Path, tmp_path: Path, index: int) -> None:
    folder = copy(accepted, tmp_path / "b")
    change_images(folder, f"*-{index}-*", lambda image: image * 1.03)
    found = compare(accepted, folder)
    assert flags(found) == {METHODS[index][1]: "regression"}
    bias = next(q for q in found.rows[0].quantities if q.id == "matched.mean_bias")
    assert bias.direction == "worse"
    assert bias.change == pytest.approx(0.03 * METHODS[index][5], rel=0.02)
    assert found.regressed


def test_three_per_cent_of_energy_is_seen_among_rows_with_other_random_numbers(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    redraw(folder, seed=7)
    change_images(folder, "*-2-flc-*", lambda image: image * 1.03)
    assert flags(compare(accepted, folder)) == {"flc": "regression"}


def test_three_per_cent_more_energy_in_a_method_too_dark_is_an_improvement(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    change_images(folder, "*-0-ir-*", lambda image: image * 1.03)
    found = compare(accepted, folder)
    assert flags(found) == {"ir vpls=1024": "improvement"}
    assert not found.regressed


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("index", [0, 3, PT])
def test_a_shift_by_one_pixel_is_a_regression(accepted: Path, tmp_path: Path, index: int, axis: int) -> None:
    folder = copy(accepted, tmp_path / "b")
    change_images(folder, f"*-{index}-*", lambda image: np.roll(image, 1, axis))
    assert flags(compare(accepted, folder)) == {METHODS[index][1]: "regression"}


def test_a_fifth_more_work_is_a_regression(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    change_counters(folder, "*-2-flc-*", lambda counters: {name: round(1.2 * n) for name, n in counters.items()})
    found = compare(accepted, folder)
    assert flags(found) == {"flc": "regression"}
    assert "rays" in found.rows[0].reasons[0]
    assert "+20.0 %" in found.rows[0].reasons[0]
    assert found.rows[0].size == pytest.approx(0.2)


def test_work_that_seeds_scatter_is_held_against_their_scatter(accepted: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    a, b, c = (copy(accepted, tmp_path / name) for name in "abc")
    for folder, factor in ((a, 1.0), (b, 1.0), (c, 1.2)):
        change_counters(
            folder, "*-2-flc-*", lambda n, f=factor: {"rays": round(f * n["rays"] * (1 + 0.01 * rng.standard_normal()))}
        )
    assert flags(compare(a, b)) == {}
    assert flags(compare(a, c)) == {"flc": "regression"}


def test_less_work_is_an_improvement_and_both_at_once_a_regression(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    change_counters(folder, "*-2-flc-*", lambda counters: {name: n // 2 for name, n in counters.items()})
    assert flags(compare(accepted, folder)) == {"flc": "improvement"}
    change_images(folder, "*-2-flc-*", lambda image: np.roll(image, 1, 0))
    assert flags(compare(accepted, folder)) == {"flc": "regression"}


def test_rounding_is_no_change(few: Path, tmp_path: Path) -> None:
    folder = copy(few, tmp_path / "b")
    rng = np.random.default_rng(1)
    change_images(folder, "*", lambda image: image * (1 + 3e-6 * rng.uniform(-1, 1, image.shape)))
    found = compare(few, folder)
    assert found.counts == {"changed-within-noise": 3}


def test_one_seed_is_undecided(tmp_path: Path) -> None:
    a = make(tmp_path / "a", methods=2)
    b = copy(a, tmp_path / "b")
    change_images(b, "*-0-ir-*", lambda image: image * 1.03)
    found = compare(a, b)
    assert flags(found) == {"ir vpls=1024": "undecided"}
    assert "one seed allows no statistics" in found.rows[0].reasons[0]
    assert not found.regressed


def test_only_newly_failed_cells_count(accepted: Path, tmp_path: Path) -> None:
    a, b = copy(accepted, tmp_path / "a"), copy(accepted, tmp_path / "b")
    fail(b, "*-2-flc-s3-*")
    found = compare(a, b)
    assert found.regressed
    assert (found.rows[0].label, found.rows[0].verdict, found.rows[0].newly_failed) == ("flc", "failed", True)
    assert "killed by SIGABRT" in found.rows[0].reasons
    fail(a, "*-2-flc-s3-*")
    known = compare(a, b)
    assert (known.rows[0].verdict, known.rows[0].newly_failed, known.regressed) == ("failed", False, False)


def test_new_gone_and_changed_scenes(accepted: Path, tmp_path: Path) -> None:
    fewer = make(tmp_path / "fewer", methods=2, seeds=SEEDS)
    assert compare(fewer, accepted).counts == {"new": PT - 1, "unchanged": 2}
    assert compare(accepted, fewer).counts == {"gone": PT - 1, "unchanged": 2}
    assert compare(None, fewer).counts == {"new": 2}
    for path in (fewer / "results").iterdir():
        path.write_text(path.read_text().replace(read(fewer)[0].scenes[0].hash, "0" * 64))
    found = compare(make(tmp_path / "again", methods=2, seeds=SEEDS), fewer)
    assert found.counts == {"new": 2}
    assert "scene itself" in found.rows[0].reasons[0]


def test_largest_change_comes_first(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    for index, factor in ((1, 1.1), (2, 1.5), (4, 1.2)):
        change_counters(folder, f"*-{index}-*", lambda counters, f=factor: {n: round(f * v) for n, v in counters.items()})
    assert [r.label for r in compare(accepted, folder).rows[:3]] == ["flc", "pmic", "ir vpls=16384"]


def test_times_are_no_verdict(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    for path in (folder / "results").iterdir():
        result = json.loads(path.read_text())
        result["timings"][1]["wall_s"] *= 3
        path.write_text(json.dumps(result))
    found = compare(accepted, folder)
    assert found.counts == {"unchanged": PT + 1}
    time = next(q for q in found.rows[0].quantities if q.id == "wall_s")
    assert (time.relative, time.direction) == (pytest.approx(2.0), "information")


def test_changed_settings_under_the_same_label_are_named(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    for path in (folder / "results").glob("*-0-ir-*"):
        result = json.loads(path.read_text())
        result["settings"]["clamp"] = 0.2
        path.write_text(json.dumps(result))
    assert "clamp was 0.1, now 0.2" in row(compare(accepted, folder), "ir vpls=1024").reasons


def move_references(folder: Path, factor: float, noise: float) -> None:
    rng = np.random.default_rng(4)
    document = json.loads((folder / "evaluation.json").read_text())
    for info in document["references"]:
        path = folder / "references" / f"{info['id']}.exr"
        layers, attributes = read_exr(path)
        draw = rng.standard_normal(layers["mean"].shape[:2])[..., None]
        layers["mean"] = (layers["mean"] * factor * (1 + noise * draw)).astype(np.float32)
        write_exr(path, {k: v for k, v in layers.items() if k}, default="mean", **attributes)
        info["content_hash"] = "0" * 64
    (folder / "evaluation.json").write_text(json.dumps(document))


def test_a_truth_that_moves_is_a_regression_and_its_noise_is_not(accepted: Path, tmp_path: Path) -> None:
    noisy, brighter = copy(accepted, tmp_path / "noisy"), copy(accepted, tmp_path / "brighter")
    move_references(noisy, 1.0, 0.004)  # the noise that `make` gives references
    move_references(brighter, 1.03, 0.004)
    calm, moved = compare(accepted, noisy), compare(accepted, brighter)
    assert {r.verdict for r in calm.references} == {"changed-within-noise"}
    assert not calm.regressed
    assert {r.verdict for r in moved.references} == {"regression"}
    assert moved.references[0].energy == pytest.approx(0.03, rel=0.05)
    assert moved.regressed
    assert moved.counts == {"unchanged": PT + 1}


def test_errors_are_measured_anew_against_one_truth(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    move_references(folder, 1.03, 0.0)
    change_images(folder, "*-3-rcs-*", lambda image: image * (1 + 1e-7))
    rcs = row(compare(accepted, folder), "rcs")
    assert rcs.verdict in ("unchanged", "changed-within-noise")


def test_sequences_are_judged_by_flicker(tmp_path: Path) -> None:
    a = make(tmp_path / "a", methods=2, seeds=SEEDS, frames=3)
    b = copy(a, tmp_path / "b")
    change_images(b, "*-1-ir-s?-f1", lambda image: image * 1.02)
    found = compare(a, b)
    quantity = next(q for q in row(found, "ir vpls=16384").quantities if q.id == "matched.flicker")
    assert quantity.direction == "worse"
    assert quantity.after > quantity.before


def test_missing_images_leave_a_changed_row_undecided(accepted: Path, tmp_path: Path) -> None:
    folder = copy(accepted, tmp_path / "b")
    change_images(folder, "*-2-flc-*", lambda image: image * 1.03)
    for path in (folder / "images").glob("*-2-flc-*"):
        path.unlink()
    found = row(compare(accepted, folder), "flc")
    assert found.verdict == "undecided"
    assert "missing" in found.reasons[0]


def test_a_comparison_survives_json(few: Path, tmp_path: Path) -> None:
    folder = copy(few, tmp_path / "b")
    redraw(folder, seed=1)
    found = compare(few, folder)
    document = json.loads(found.model_dump_json())
    assert document["counts"] == found.counts
    assert Comparison.model_validate({k: v for k, v in document.items() if k not in ("counts", "regressed")}) == found


def test_a_folder_without_an_evaluation_is_refused(accepted: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="holds no evaluation"):
        compare(accepted, tmp_path)
