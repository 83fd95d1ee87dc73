"""What a worker that is stopped (SIGSTOP, Ctrl-Z) still holds, and how others get it: they can't ask, so they act on its process.

A stopped worker isn't dead: its locks stay, and its children, which nobody stopped, go on. Acted on are only workers of one data
folder and machine, found by the lock that each of them holds on its place.
"""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path


def is_stopped(pid: int) -> bool:
    """Whether a process is stopped by a signal."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "T"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wake(pid: int) -> bool:
    """Let a stopped process go on, so that it can let go of what it holds; whether it was stopped."""
    if not is_stopped(pid):
        return False
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)
    return True


def end_tasks(pid: int) -> int:
    """Kill the tasks that a process has in children, each with all it started: what they make is lost anyway. How many."""
    tasks = [child for child in children(pid) if _is_task(child)]
    for child in tasks:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    return len(tasks)


def children(pid: int) -> list[int]:
    """Process ids of the children of a process."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            if stat.read_text().rsplit(")", 1)[1].split()[1] == str(pid):
                found.append(int(stat.parent.name))
    return found


def _is_task(pid: int) -> bool:
    """Whether a process carries out a task: it leads a session of its own."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return b"jobs.child" in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0") and os.getsid(pid) == pid
    return False
