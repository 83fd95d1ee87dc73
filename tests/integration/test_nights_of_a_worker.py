"""A worker that renders the nightly suite when its cron line says so."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest
from service_processes import wait

from jobs.durable.station import Stopped
from jobs.errors import RequestError
from jobs.stopped import children
from reports.runs import history
from service.cli import run
from service.nights import Nights

pytestmark = pytest.mark.usefixtures("toy_methods")
ROOT = Path(__file__).parents[2]
SUITE = """
name = "tiny"
[part.only]
scenes = ["cornell-box"]
methods = [{{ name = "flat", settings = {{ mode = "{mode}" }} }}]
size = [8, 6]
noise = 0.5
"""


def suite(folder: Path, mode: str = "good") -> Path:
    path = folder / "tiny.toml"
    path.write_text(SUITE.format(mode=mode))
    return path


@pytest.mark.mitsuba
def test_a_worker_renders_its_suite_at_the_time_of_its_cron_line(tmp_path: Path) -> None:
    home = tmp_path / "home"
    command = [sys.executable, "-m", "service", "worker", "--nightly", str(suite(tmp_path)), "--cron", "*/5 * * * * *"]
    with (tmp_path / "log").open("wb") as log:
        worker = subprocess.Popen(command, cwd=ROOT, env=os.environ | {"LUXMETER_HOME": str(home)}, stderr=log)
        try:
            wait(lambda: "nightly suite ended with exit code 0" in (tmp_path / "log").read_text(), 90, worker)
        finally:
            worker.send_signal(signal.SIGTERM)
            worker.wait(40)
    found = history(home)[-1]
    assert (found.suite, found.cells, found.failed) == ("tiny", 1, 0)
    assert (home / "nightly" / "runs" / found.id / "index.html").is_file()


def test_a_night_ends_with_its_worker_and_leaves_no_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    stop = threading.Event()
    nights = Nights(suite(tmp_path, "hang"), tmp_path / "home", stop)
    threading.Timer(2.0, stop.set).start()
    before = set(children(os.getpid()))
    overlapping = threading.Timer(0.5, nights, [datetime.now(UTC)])
    overlapping.start()
    with pytest.raises(Stopped):
        nights(datetime.now(UTC))
    overlapping.join()
    assert "the one before still runs" in caplog.text
    assert set(children(os.getpid())) <= before
    assert history(tmp_path / "home") == []


def test_options_that_cannot_be_are_refused_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RequestError, match="tiny"):
        Nights(tmp_path / "tiny.toml", tmp_path, threading.Event())
    for options in (["--cron", "at midnight"], ["--nightly", str(tmp_path / "none.toml")], ["--webhook", "file:///etc"]):
        assert run(["worker", *options]) == 2
        assert run(["serve", "--port", "0", *options]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 2
