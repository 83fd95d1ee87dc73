"""The nightly suite as a worker runs it: `luxmeter nightly` in a process of its own, ended with the worker.

python -m service.nights PARENT ARGUMENTS…    is `luxmeter ARGUMENTS…`, killed when the process PARENT ends
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
from datetime import datetime
from pathlib import Path
from typing import IO

from jobs.child import die_with
from jobs.errors import RequestError
from jobs.process import child_environment
from service import suite as suites

POLL_S = 0.2
STOP_S = 8.0
CRON = "0 3 * * *"
log = logging.getLogger(__name__)


class Nights:
    """Called at the times of a cron line: renders the suite, compares the run with the accepted one, keeps it in the data folder.

    Raises RequestError at once for a suite that can't be read or planned. What goes wrong at night is logged; the next night comes.
    """

    def __init__(self, suite: Path, home: Path, stop: threading.Event, webhook: str | None = None) -> None:
        suites.load(suite).plans()
        self._arguments = ["nightly", "--suite", str(suite.resolve()), "--quiet", *(["--webhook", webhook] if webhook else [])]
        self._home, self._stop = home, stop
        self._running = threading.Lock()

    def __call__(self, scheduled: datetime) -> None:
        """One night. Raises Stopped when the worker is told to stop before it is over: the next worker runs it anew."""
        if not self._running.acquire(blocking=False):
            log.warning("the night of %s is left out: the one before still runs", scheduled.isoformat(timespec="minutes"))
            return
        try:
            self._run(scheduled)
        finally:
            self._running.release()

    def _run(self, scheduled: datetime) -> None:
        log.info("nightly suite of %s begins", scheduled.isoformat(timespec="minutes"))
        with tempfile.TemporaryFile("w+", errors="replace") as output:
            code = self._carry_out(output)
            output.seek(0)
            said = [line.strip() for line in output if line.strip()]
        level = {0: logging.INFO, 1: logging.WARNING}.get(code, logging.ERROR)
        log.log(level, "nightly suite ended with exit code %d: %s", code, said[-1] if said else "it said nothing")

    def _carry_out(self, output: IO[str]) -> int:
        from jobs.durable.station import Stopped  # the worker that calls this has loaded it; the command line starts without

        environment = child_environment() | {"LUXMETER_HOME": str(self._home)}
        command = [sys.executable, "-P", "-m", "service.nights", str(os.getpid()), *self._arguments]
        child = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT)
        try:
            while child.poll() is None:
                if self._stop.wait(POLL_S):
                    raise Stopped
        finally:
            _end(child)
        return child.returncode


def check_cron(line: str) -> None:
    """Raises RequestError unless the line is a cron expression."""
    from croniter import croniter

    if not croniter.is_valid(line, second_at_beginning=True):
        raise RequestError(f"--cron takes five fields, minute hour day month weekday, in UTC (got {line!r})")


def main(arguments: list[str]) -> int:
    """Run one command of the command line; its exit code."""
    from service.cli import run

    die_with(int(arguments[0]))
    return run(arguments[1:])


def _end(child: subprocess.Popen[bytes]) -> None:
    """As Ctrl-C would, so that nothing of the run is left; killed where that takes too long."""
    if child.poll() is not None:
        return
    child.send_signal(signal.SIGINT)
    try:
        child.wait(STOP_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
