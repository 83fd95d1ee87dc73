"""Small child processes for work on files of strangers: bounded in memory and time, answering with one JSON line."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from typing import Any

from jobs.process import child_environment

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


class Refused(ValueError):
    """The child's answer was an error, or it went over a limit; one line."""


def run(module: str, arguments: list[str], seconds: float, memory_bytes: int) -> dict[str, Any]:
    """Run `python -m MODULE MEMORY SECONDS ARGUMENTS…` in its own session. Raises Refused."""
    command = [sys.executable, "-P", "-m", module, str(memory_bytes), str(int(seconds) + 1), *arguments]
    environment = child_environment() | ONE_THREAD
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=seconds,
            env=environment,
            start_new_session=True,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise Refused(f"takes longer than {seconds:g} s") from None
    lines = done.stdout.decode(errors="replace").strip().splitlines()
    if done.returncode != 0 or not lines:
        raise Refused(
            f"needs more than {memory_bytes / 2**20:.0f} MiB of memory, or breaks the reader (exit code {done.returncode})"
        )
    answer: dict[str, Any] = json.loads(lines[-1])
    if "error" in answer:
        raise Refused(str(answer["error"]))
    return answer


def limit_this_process(memory_bytes: int, cpu_s: int) -> None:
    """Called first thing in the child: bound its address space and processor time, and let it leave no core file."""
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def answer(document: dict[str, Any]) -> None:
    """Print the child's one line."""
    print(json.dumps(document), flush=True)
