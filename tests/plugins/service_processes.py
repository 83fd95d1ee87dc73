"""The service and its workers as processes of their own, as an operator starts them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx
from waiting import until

ROOT = Path(__file__).parents[2]


@contextmanager
def process(arguments: Sequence[str], environment: Mapping[str, str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """`luxmeter ARGUMENTS…` while the block runs, then told to end; it has to end well."""
    with log.open("ab") as output:
        command = [sys.executable, "-m", "service", *arguments]
        found = subprocess.Popen(command, cwd=ROOT, env=os.environ | environment, stderr=output, stdout=output)
    try:
        yield found
    finally:
        found.send_signal(signal.SIGTERM)
        code = found.wait(60)
    assert code in (0, 130), log.read_text()[-2000:]


@contextmanager
def service(environment: Mapping[str, str], log: Path, *options: str) -> Iterator[str]:
    """The address of a service that answers."""
    port = free_port()
    with process(["serve", "--port", str(port), *options], environment, log) as found:
        address = f"http://127.0.0.1:{port}"
        wait(lambda: httpx.get(f"{address}/healthz").status_code == 200, 90, found)
        yield address


def wait(ready: Callable[[], bool], seconds: float, process: subprocess.Popen[bytes] | None = None) -> None:
    """Return once it is ready; an unreachable server isn't yet."""

    def answers() -> bool:
        assert process is None or process.poll() is None, "the process ended"
        try:
            return ready()
        except httpx.TransportError:
            return False

    until(answers, f"not within {seconds} s", seconds)


def gone(address: str) -> None:
    """Return once nothing answers at the address any more."""

    def silent() -> bool:
        try:
            httpx.get(f"{address}/healthz")
        except httpx.TransportError:
            return True
        return False

    until(silent, "the service did not end")


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
