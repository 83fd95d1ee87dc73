"""Run a task in a child process of its own: own process group, killed as one, bounded in time and memory."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from jobs.errors import Failure, TaskError
from jobs.leftovers import work_folder
from jobs.tasks import AnyTask

POLL_S = 0.1
ROOT = Path(__file__).resolve().parents[1]


class Flag(Protocol):
    """Something that says when to stop, such as a threading.Event."""

    def is_set(self) -> bool:
        """Whether to stop now; asked ten times a second."""


@dataclass(frozen=True)
class Limits:
    """Bounds of one child: wall seconds, resident bytes (None: unbounded), and a flag that cancels it."""

    wall_s: float | None = None
    memory_bytes: int | None = None
    cancel: Flag = field(default_factory=threading.Event)


def run_task(task: AnyTask, limits: Limits, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Carry out the task in a child process; returns what it answers. Raises TaskError in one line, with the child's log."""
    with work_folder() as folder:
        order, answer, log = folder / "task.json", folder / "answer.json", folder / "log.txt"
        order.write_text(task.model_dump_json())
        reader, writer = os.pipe()
        with open(reader, "rb", buffering=0) as pipe, log.open("wb") as output:
            command = [sys.executable, "-P", "-m", "jobs.child", str(order), str(answer), str(writer), str(os.getpid())]
            child = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=child_environment(), pass_fds=(writer,),
                process_group=0,  # not a session: Linux shares the processor out among sessions first, whatever their niceness
            )  # fmt: skip
            os.close(writer)
            try:
                reason = _watch(child, pipe, limits, progress)
            finally:
                _kill_group(child)
        text = log.read_text(errors="replace")
        reply: dict[str, Any] = json.loads(answer.read_text()) if answer.is_file() else {}
    if reason is not None:
        raise TaskError(reason[1], text, reason[0])
    if "error" in reply:
        raise TaskError(reply["error"], text)
    if child.returncode != 0:
        raise TaskError(_post_mortem(child.returncode, text), text, "crash")
    return reply


def child_environment() -> dict[str, str]:
    """The environment of this process, in which the child finds the same modules as we do."""
    path = [str(ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return os.environ | {"PYTHONPATH": os.pathsep.join(dict.fromkeys(path)), "PYTHONUNBUFFERED": "1"}


def _watch(
    child: subprocess.Popen[bytes], pipe: BinaryIO, limits: Limits, progress: Callable[[dict[str, Any]], None]
) -> tuple[Failure, str] | None:
    """Wait for the child, passing its progress on; kind and reason where it has to be killed."""
    end = time.monotonic() + limits.wall_s if limits.wall_s is not None else float("inf")
    pending = b""
    with selectors.DefaultSelector() as selector:
        selector.register(pipe, selectors.EVENT_READ)
        while child.poll() is None:
            if selector.select(POLL_S):
                data = os.read(pipe.fileno(), 65536)
                *lines, pending = (pending + data).split(b"\n")
                for line in lines:
                    progress(json.loads(line))
                if not data:
                    selector.unregister(pipe)
            if limits.cancel.is_set():
                return "cancelled", "cancelled"
            if time.monotonic() > end:
                return "timeout", f"took longer than {limits.wall_s:g} s"
            if limits.memory_bytes is not None and _resident_bytes(child.pid) > limits.memory_bytes:
                return "memory", f"used more than {limits.memory_bytes / 2**20:.0f} MiB of memory"
    return None


def _resident_bytes(pid: int) -> int:
    """Resident set size of a process, 0 once it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (FileNotFoundError, ProcessLookupError):
        return 0


def _kill_group(child: subprocess.Popen[bytes]) -> None:
    """End the child and all it started; a child that ended by itself may have left some."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


def _post_mortem(code: int, log: str) -> str:
    """One line on a child that ended without an answer: the signal or exit code and the last line it wrote."""
    cause = f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    return f"{cause}: {lines[-1]}" if lines else cause
