"""Nightly runs in a data folder, for tests of what the service shows of them."""

from __future__ import annotations

from pathlib import Path

import nightly_folders
from report_evaluation import make

from reports import regression
from reports.runs import RunInfo, accept, digest, read_run, runs_folder

FIRST, SECOND = "2026-03-01T03-00-00Z", "2026-03-02T03-00-00Z"


def two_nights(home: Path) -> None:
    """An accepted run, and the one of the next night: 3 % more energy and 20 % more work in one row."""
    first, second = (runs_folder(home) / name for name in (FIRST, SECOND))
    make(first / "diffuse", methods=3, seeds=6)
    add_run(first, None)
    accept(home, first)
    nightly_folders.copy(first / "diffuse", second / "diffuse")
    cell = "cornell-box-0-*"
    nightly_folders.change_images(second / "diffuse", cell, lambda image: image * 1.03)
    nightly_folders.change_counters(second / "diffuse", cell, lambda counters: {k: v * 6 // 5 for k, v in counters.items()})
    add_run(second, first)


def add_run(folder: Path, baseline: Path | None) -> RunInfo:
    """Write the `run.json` of a folder of evaluations."""
    comparison = regression.compare(baseline, folder)
    known = None if baseline is None else read_run(baseline).id
    run = RunInfo(
        id=folder.name, suite="nightly", started=folder.name.replace("-00-00Z", ":00:00Z"), seconds=12.5, code="c" * 64,
        digest=digest(folder), cells=18, failed=0, baseline=known, counts=comparison.counts, regressed=comparison.regressed,
    )  # fmt: skip
    (folder / "run.json").write_text(run.model_dump_json())
    return run
