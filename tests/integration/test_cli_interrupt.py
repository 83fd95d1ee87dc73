"""Ctrl-C and a polite kill: the children end, and the report of what was done is written."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import until

from jobs.process import child_environment

HANGING = "render:cornell-box.flat-mode-hang.s0"
pytestmark = [pytest.mark.usefixtures("toy_methods"), pytest.mark.gl, pytest.mark.mitsuba]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_evaluation_that_is_interrupted(number: signal.Signals, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-c",
        "from service.cli import main; main()",
        "evaluate",
        "--scene",
        "cornell-box",
        "--method",
        "flat",
    ]
    options = ["--sweep", "flat.mode=good,hang", "--size", "8x6", "--noise", "0.3", "--out", str(out), "--json"]
    job = subprocess.Popen([*command, *options], env=child_environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until(_the_second_render_runs, "the second render did not start")
    job.send_signal(number)
    stdout, _ = job.communicate(timeout=60)
    assert job.returncode == 1
    assert [cell["state"] for cell in json.loads(stdout)["cells"]] == ["done", "cancelled"]
    assert (out / "index.html").is_file()
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def _the_second_render_runs() -> bool:
    """Whether the run's database says that the first render is done and the second one under way."""
    for path in Path(os.environ["LUXMETER_HOME"]).glob("runs/*.sqlite"):
        with contextlib.closing(sqlite3.connect(path)) as database, contextlib.suppress(sqlite3.OperationalError):
            states = dict(database.execute("select node, state from luxmeter_nodes"))
            first, second = (states.get(name) for name in ("render:cornell-box.flat-mode-good.s0", HANGING))
            if (first, second) == ("done", "running"):
                return True
    return False
