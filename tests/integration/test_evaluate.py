"""Evaluations from the request to the report. References are stand-ins here: exact images, so that every error is known."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import workers

import jobs
from jobs.errors import TaskError
from jobs.evaluate import Event
from jobs.process import Limits
from jobs.store import Store
from jobs.tasks import PilotTask, ReferenceTask, RenderTask
from renderers.images import display_values, read_exr
from reports.folder import Evaluation, read

pytestmark = [pytest.mark.usefixtures("toy_methods"), pytest.mark.gl]

Task = RenderTask | PilotTask | ReferenceTask
SIZE = (16, 12)


def evaluation(folder: Path, runner: Any = workers.half_real, **changes: Any) -> Evaluation:
    body = {"scenes": ["cornell-box"], "methods": [{"name": "flat"}], "size": SIZE} | changes
    options = jobs.Options(store=Store(folder / "home"), runner=runner)
    return jobs.evaluate(jobs.plan(jobs.EvaluationRequest.model_validate(body)), folder / "out", options)


def test_errors_are_those_of_the_images(tmp_path: Path) -> None:
    done = evaluation(tmp_path, methods=[{"name": "flat", "sweep": {"level": [0.5, 0.6]}}], seeds=2)
    stored, results = read(tmp_path / "out")
    assert stored == done
    assert [cell.state for cell in done.cells] == ["done"] * 4
    exact = results["cornell-box.flat-level-0.5.s0.f0000"]
    assert exact.metrics["matched"]["rmse"] == 0
    difference = display_values(np.float32([0.5]), 1.0) - display_values(np.float32([0.75]), 1.0)
    assert exact.metrics["full"]["rmse"] == pytest.approx(abs(float(difference[0])))
    assert results["cornell-box.flat-level-0.6.s1.f0000"].metrics["matched"]["rmse"] == pytest.approx(
        float((display_values(np.float32([0.6]), 1.0) - display_values(np.float32([0.5]), 1.0))[0])
    )
    floor = exact.noise_floor["matched"]["rmse"]
    assert floor is not None
    assert 0 < floor < 0.001
    assert done.scenes[0].aliasing["rmse"] == 0
    assert done.scenes[0].exposure == 1.0
    assert [info.id for info in done.references] == [
        "cornell-box.direct.centre.f0000", "cornell-box.full.box.f0000", "cornell-box.full.centre.f0000",
    ]  # fmt: skip
    for name in ("index.html", "results.csv", "results.parquet"):
        assert (tmp_path / "out" / name).is_file()


def test_a_crash_is_the_cells_error_and_the_report_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jobs.work.BACK_OFF_S", workers.BACK_OFF_S)
    done = evaluation(tmp_path, methods=[{"name": "flat", "sweep": {"mode": ["good", "abort", "raise"]}}])
    assert [cell.state for cell in done.cells] == ["done", "failed", "failed"]
    errors = [cell.error or "" for cell in done.cells]
    assert errors[0] == ""
    assert errors[1].startswith("killed by SIGABRT")
    assert errors[2] == "ValueError: no such colour"
    logs = tmp_path / "out" / "logs"
    assert "Traceback" in (logs / "render.cornell-box.flat-mode-raise.s0.txt").read_text()
    assert "no such colour" in (tmp_path / "out" / "index.html").read_text()


def test_a_failed_reference_fails_the_cells_that_need_it(tmp_path: Path) -> None:
    def broken(task: Task, limits: Limits, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
        if isinstance(task, ReferenceTask) and task.transport == "direct":
            raise TaskError("no light")
        return workers.half_real(task, limits, progress)

    done = evaluation(tmp_path, broken, methods=[{"name": "flat"}, {"name": "budget"}])
    assert [(cell.method, cell.state) for cell in done.cells] == [("flat", "failed"), ("budget", "done")]
    assert done.cells[0].error == "reference:cornell-box.direct.centre.f0000: no light"
    assert (tmp_path / "out" / "index.html").is_file()


def test_an_interrupt_cancels_what_is_left_and_reports_the_rest(tmp_path: Path) -> None:
    """Ctrl-C comes when the first render has ended; the interrupted main thread waits for the report."""

    def interrupt(event: Event) -> None:
        if event.node.kind == "render" and event.state == "done":
            signal.raise_signal(signal.SIGINT)

    wanted = {"name": "flat", "sweep": {"mode": ["good", "hang"]}}
    request = jobs.EvaluationRequest.model_validate({"scenes": ["cornell-box"], "methods": [wanted], "size": SIZE})
    options = jobs.Options(store=Store(tmp_path / "home"), runner=workers.half_real)
    done = jobs.evaluate(jobs.plan(request), tmp_path / "out", options, interrupt)
    assert [cell.state for cell in done.cells][1] == "cancelled"
    assert (tmp_path / "out" / "index.html").is_file()
    assert list((tmp_path / "home" / "runs").glob("*.sqlite*")) == []


def test_pilots_run_once_and_their_settings_reach_every_seed(tmp_path: Path) -> None:
    done = evaluation(tmp_path, methods=[{"name": "budget", "settings": {"seconds": 0.3}}], seeds=2)
    _, results = read(tmp_path / "out")
    assert [cell.state for cell in done.cells] == ["done", "done"]
    assert [result.settings["steps"] for result in results.values()] == [3, 3]
    assert len(list((tmp_path / "out" / "pilots").iterdir())) == 1


def test_frames_are_compared_one_by_one(tmp_path: Path) -> None:
    evaluation(tmp_path, methods=[{"name": "flat", "settings": {"level": 0.25}}], frames=(0, 1))
    _, results = read(tmp_path / "out")
    errors = [results[f"cornell-box.flat-level-0.25.s0.f000{k}"].metrics["matched"]["rmse"] for k in (0, 1)]
    assert errors[0] is not None
    assert errors[0] > 0
    assert errors[1] == 0


def test_the_scenes_own_exposure_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from renderers.scene import builtin

    box = builtin.BUILTIN["cornell-box"]
    monkeypatch.setitem(builtin.BUILTIN, "cornell-box", lambda: replace(box(), exposure=0.5))
    assert evaluation(tmp_path).scenes[0].exposure == 0.5


@pytest.mark.mitsuba
def test_the_command_line_with_real_references(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from service.cli import run

    arguments = ["evaluate", "--scene", "cornell-box", "--method", "pt", "--set", "pt.spp=4", "--size", "16x12", "--noise", "0.2"]
    assert run([*arguments, "--out", str(tmp_path / "out"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    stored, results = read(tmp_path / "out")
    assert document == stored.model_dump(mode="json")
    result = results["cornell-box.pt-spp-4.s0.f0000"]
    assert (result.metrics["full"]["rmse"] or 0) > (result.noise_floor["full"]["rmse"] or 0) > 0
    assert stored.scenes[0].exposure > 0
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_report_that_fails_loses_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import reports
    from service.cli import run

    def broken(folder: Path) -> Path:
        raise ValueError("no ink")

    monkeypatch.setattr(reports, "write", broken)
    monkeypatch.setattr("service.commands._evaluate.Options", lambda **given: jobs.Options(**given, runner=workers.half_real))
    out = tmp_path / "out"
    assert run(["evaluate", "--scene", "cornell-box", "--method", "flat", "--size", "8x6", "--out", str(out)]) == 1
    assert "report: ValueError: no ink" in capsys.readouterr().err
    assert len(list((out / "results").iterdir())) == 1
    assert "Traceback" in next((out / "logs").iterdir()).read_text()


def test_a_sequence_is_compared_where_it_has_references(tmp_path: Path) -> None:
    wanted = {"name": "flat", "settings": {"level": 0.1}}
    evaluation(tmp_path, methods=[wanted], frames=(0, 6), references={"every": 5, "windows": [(1, 2)]})
    stored, results = read(tmp_path / "out")
    rows = [results[cell.id] for cell in stored.cells]
    assert [row.frame for row in rows if row.metrics] == [0, 1, 2, 5]
    assert all(row.timings and row.frame_hash for row in rows)
    # The truth stands still while the test's level is 0.1, 0.2, 0.3: its flicker is its own change.
    shown = [float(display_values(np.float32([0.1 * (1 + k)]), 1.0)[0]) for k in range(3)]
    assert [row.metrics["matched"].get("flicker") for row in rows if row.metrics] == [
        None, pytest.approx(shown[1] - shown[0], rel=1e-5), pytest.approx(shown[2] - shown[1], rel=1e-5), None,
    ]  # fmt: skip
    assert rows[1].metrics["full"]["flicker_linear"] == pytest.approx(0.1 / 0.75, rel=1e-5)
    assert 0 < (rows[1].noise_floor["matched"]["flicker"] or 0) < 0.001
    assert {info.frame for info in stored.references} == {0, 1, 2, 5}


def test_a_method_with_state_renders_the_frames_between_references_too(tmp_path: Path) -> None:
    evaluation(tmp_path, methods=[{"name": "tally"}], frames=(2, 6), references={"every": 4})
    images = [read_exr(tmp_path / "out" / "images" / f"cornell-box.tally.s0.f000{k}.exr")[0]["beauty"] for k in range(2, 7)]
    assert [float(image[0, 0, 0]) for image in images] == [1, 2, 3, 4, 5]
    page = (tmp_path / "out" / "index.html").read_text()
    assert "white: eight frames or more" in page
    assert "2 compared" in page
