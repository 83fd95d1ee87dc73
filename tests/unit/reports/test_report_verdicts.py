"""Rows gathered from cells, and what the verdicts say of them."""

from __future__ import annotations

from typing import Any

from reports.evidence import bars
from reports.folder import Cell, Evaluation, SceneInfo
from reports.results import Result
from reports.rows import Row, gather
from reports.statistics import Budget
from reports.tables import frame, overview, settings_table
from reports.verdicts import best_values, order, speed_sentence, summary


def cell(method: str, seed: int, **more: Any) -> Cell:
    values = {"label": method, "settings": {"k": 1}, "frame": 0, "width": 8, "height": 8, "transport": "full", "state": "done"}
    return Cell(id=f"{method}-{seed}-{more.get('frame', 0)}", scene="box", method=method, seed=seed, **(values | more))


def result(c: Cell, rmse: float, seconds: float = 1.0, **more: Any) -> Result:
    timing = {"name": "shade", "wall_s": seconds, "cpu_s": 2 * seconds, "gpu_s": None, "calls": 1, "stage": "render"}
    metrics = {a: {"rmse": rmse, "ssim": 0.9} for a in ("matched", "full")}
    values = {"metrics": metrics, "frame_hash": f"{rmse}", "device": {"gl": "llvmpipe"}, "timings": [timing], "settings_hash": "s"}
    taken = c.model_dump(exclude={"id", "state", "error"})
    return Result(scene_hash="h", **(taken | values | more))


def rows_of(*given: tuple[Cell, Result | None]) -> list[Row]:
    evaluation = Evaluation(
        id="e", created="now", request={}, scenes=[SceneInfo(name="box", hash="h")], cells=[c for c, _ in given]
    )
    return gather(evaluation, {c.id: r for c, r in given if r is not None})["box"]


def seeds(method: str, values: list[float], **more: Any) -> list[tuple[Cell, Result]]:
    return [((c := cell(method, seed)), result(c, value, **more)) for seed, value in enumerate(values)]


def yes(*_: object) -> bool:
    return True


def test_rows_gather_seeds_and_average_frames() -> None:
    cells = [cell("ir", s, frame=f) for s in (0, 1) for f in (0, 1)]
    (row,) = rows_of(*((c, result(c, 1.0 + c.seed + 10 * c.frame)) for c in cells))
    assert row.values("matched", "rmse") == [6.0, 7.0]
    assert row.frames == [0, 1]
    assert row.values("matched", "flip_hdr") == []


def test_devices_and_sizes_make_rows_of_their_own() -> None:
    a, b, c = cell("ir", 0), cell("ir", 1), cell("ir", 2, width=16)
    rows = rows_of((a, result(a, 1)), (b, result(b, 1, device={"gl": "H100"})), (c, result(c, 1)))
    assert [(r.device, r.label) for r in rows] == [("llvmpipe", "ir · 8×8"), ("H100", "ir · 8×8"), ("llvmpipe", "ir · 16×8")]


def test_failed_cells_stay_in_their_row() -> None:
    done, failed = cell("ir", 0), cell("ir", 1, state="failed", error="boom")
    (row,) = rows_of((done, result(done, 1)), (failed, None))
    assert row.failed == [failed]
    assert summary([row], yes)[-1] == "1 of 2 cells failed."


def test_decided_needs_more_than_the_spread_over_seeds() -> None:
    clear = order(rows_of(*seeds("a", [1.0, 1.1, 1.2]), *seeds("b", [3.0, 3.1, 3.2])), "matched", yes)
    close = order(rows_of(*seeds("a", [1.0, 2.0, 1.5]), *seeds("b", [1.1, 2.2, 1.6])), "matched", yes)
    assert clear is not None
    assert close is not None
    assert (clear.best.label, clear.kind) == ("a", "decided")
    assert close.kind == "within seeds"


def test_one_seed_allows_no_statistics() -> None:
    found = order(rows_of(*seeds("a", [1.0]), *seeds("b", [3.0])), "matched", yes)
    assert found is not None
    assert (found.kind, found.half) == ("one seed", None)


def test_reference_may_be_unable_to_decide() -> None:
    rows = rows_of(*seeds("a", [1.0, 1.1]), *seeds("b", [9.0, 9.1]))
    found = order(rows, "matched", lambda *_: False)
    assert found is not None
    assert found.kind == "within reference"
    assert "too noisy" in summary(rows, lambda *_: False)[0]


def test_identical_bytes_come_before_statistics() -> None:
    rows = rows_of(*seeds("a", [1.0, 2.0], frame_hash="x"), *seeds("b", [1.0, 2.0], frame_hash="x"))
    found = order(rows, "matched", lambda *_: False)
    assert found is not None
    assert found.kind == "identical"
    assert "unchanged" in summary(rows, yes)[0]
    assert rows[0].unchanged


def test_missing_hashes_are_not_identical() -> None:
    found = order(rows_of(*seeds("a", [1.0], frame_hash=""), *seeds("b", [1.0], frame_hash="")), "matched", yes)
    assert found is not None
    assert found.kind == "one seed"


def test_one_method_and_none() -> None:
    assert "nothing else was measured" in summary(rows_of(*seeds("a", [1.0])), yes)[0]
    assert summary(rows_of((cell("a", 0, state="failed"), None)), yes) == ["All cells failed."]


def test_best_follows_the_direction_and_leaves_out_full_ties() -> None:
    rows = rows_of(*seeds("a", [1.0]), *seeds("b", [3.0]))
    assert best_values(rows, "matched", "rmse") == {rows[0].key}
    assert best_values(rows, "matched", "ssim") == set()


def test_speed_is_compared_on_one_device_only() -> None:
    ours = seeds("flc", [2.0], seconds=4.0)
    assert (
        speed_sentence(rows_of(*ours, *seeds("pt", [6.0], seconds=3.0)), "full")
        == "In the 4.00 s of flc, path tracing has 3.00 × its RMSE."
    )
    assert speed_sentence(rows_of(*ours, *seeds("pt", [6.0], seconds=3.0, device={"gl": "H100"})), "full") is None


def test_settings_tell_differences() -> None:
    a, b = cell("a", 0, settings={"k": 1, "same": "x"}), cell("b", 0, settings={"k": 2, "same": "x"})
    lines = {line["name"]: line for line in settings_table(rows_of((a, result(a, 1)), (b, result(b, 1))))}
    assert lines["k"] == {"name": "k", "values": ["1", "2"], "differs": True}
    assert not lines["same"]["differs"]


def test_data_frame_has_a_line_per_cell() -> None:
    done, failed = cell("ir", 0), cell("ir", 1, state="failed", error="boom")
    evaluation = Evaluation(id="e", created="now", request={}, scenes=[], cells=[done, failed])
    table = frame(evaluation, {done.id: result(done, 1.5, counters={"rays": 7})})
    assert list(table["id"]) == [done.id, failed.id]
    assert table["matched.rmse"][0] == 1.5
    assert table["counters.rays"][0] == 7
    assert table["error"][1] == "boom"


def test_overview_marks_what_failed() -> None:
    rows = rows_of(*seeds("a", [1.0]), (cell("b", 0, state="failed"), None))
    labels, (line,) = overview({"box": rows})
    assert labels == ["a", "b"]
    assert [c["note"] for c in line["cells"]] == ["full 1.00", "failed"]


def test_bars_share_a_scale_and_negative_parts_stand_left_of_zero() -> None:
    (row,) = rows_of(*seeds("a", [1.0]))
    zero, ((_, _, first), (_, _, second)) = bars([(row, Budget(2, 3, 0, 4, 4, 9, 2)), (row, Budget(2, 0.5, 0, -1, 4, 1.5, 2))])
    assert zero == 10
    assert [(b.left, b.width) for b in first] == [(10, 20), (30, 30), (60, 0), (60, 40)]
    assert (second[-1].left, second[-1].width) == (0, 10)
