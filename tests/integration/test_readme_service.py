"""The README's commands for the service, exactly as they stand there but for the port; and how soon the service is ready."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import httpx
import pytest
from service_processes import free_port, gone, process, wait

ROOT = Path(__file__).parents[2]
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
            gone(f"http://127.0.0.1:{port}")


def test_a_new_service_is_ready_without_what_renders(tmp_path: Path) -> None:
    """From an empty data folder, with its worker, to the checks of OpenGL and Mitsuba passed, in children. The service itself has
    none of the libraries that take seconds to load; `benchmarks/service.py` says how long it takes."""
    port = free_port()
    with process(["serve", "--port", str(port)], {"LUXMETER_HOME": str(tmp_path / "home")}, tmp_path / "log") as server:
        wait(lambda: httpx.get(f"http://127.0.0.1:{port}/readyz", timeout=30).status_code == 200, 120, server)
        mapped = Path(f"/proc/{server.pid}/maps").read_text()
    assert "python" in mapped
    assert [name for name in ("mitsuba", "drjit", "llvmlite", "libembree", "libEGL") if name in mapped] == []
