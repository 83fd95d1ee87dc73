"""The README's commands for the service, exactly as they stand there but for the port; and how soon the service is ready."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from service_processes import free_port, process, wait

ROOT = Path(__file__).parents[2]
READY_S = 10.0
pytestmark = pytest.mark.mitsuba


def block() -> str:
    """The block of commands that starts the service."""
    (found,) = [text for text in re.findall(r"```bash\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL) if "curl" in text]
    return found


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_the_readme_submits_and_fetches_a_report(tmp_path: Path) -> None:
    shim = tmp_path / "bin" / "luxmeter"
    shim.parent.mkdir()
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m service "$@"\n')
    shim.chmod(0o755)
    environment = os.environ | {
        "PATH": f"{shim.parent}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "LUXMETER_HOME": str(tmp_path / "home"),
    }  # fmt: skip
    port = free_port()
    commands = "set -e\n" + block().replace("8000", str(port))
    with (tmp_path / "log").open("wb") as log:
        shell = subprocess.Popen(
            ["bash", "-c", commands], cwd=tmp_path, env=environment, start_new_session=True, stdout=log, stderr=log
        )
        try:
            assert shell.wait(240) == 0, (tmp_path / "log").read_text()[-2000:]
            assert "Speed against error" in (tmp_path / "report.html").read_text()
            made = json.loads((tmp_path / "evaluation.json").read_text())
            assert httpx.get(f"http://127.0.0.1:{port}/v1/evaluations/{made['id']}").json()["state"] == "done"
        finally:
            os.killpg(shell.pid, signal.SIGTERM)
            gone(port)


def gone(port: int) -> None:
    """Wait until the service has ended."""
    end = time.monotonic() + 40
    while time.monotonic() < end:
        try:
            httpx.get(f"http://127.0.0.1:{port}/healthz")
        except httpx.TransportError:
            return
        time.sleep(0.1)
    raise AssertionError("the service did not end")


def test_a_new_service_is_ready_in_ten_seconds(tmp_path: Path) -> None:
    """From an empty data folder, with its worker, to the checks of OpenGL and Mitsuba passed."""
    port = free_port()
    start = time.monotonic()
    with process(["serve", "--port", str(port)], {"LUXMETER_HOME": str(tmp_path / "home")}, tmp_path / "log") as server:
        wait(lambda: httpx.get(f"http://127.0.0.1:{port}/readyz", timeout=30).status_code == 200, 120, server)
        wall = time.monotonic() - start
        spent = processor_seconds(server.pid)
    # Processor seconds of the service and its checks: what it takes on an idle machine, whatever else runs here.
    assert min(wall, spent) < READY_S


def processor_seconds(pid: int) -> float:
    """Of a process and of those of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
