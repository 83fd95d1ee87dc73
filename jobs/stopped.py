"""What a process that is stopped (SIGSTOP, Ctrl-Z) still holds, and how others get it: they can't ask, so they act on it.

A stopped worker isn't dead: its locks stay, and its children, which nobody stopped, go on. The tasks of a worker are ended that is
known by the lock on its place; whoever holds the lock of a database is woken, worker or not.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Sequence
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


def keepers(database: Path) -> list[int]:
    """Process ids of those who keep others from an SQLite file by a lock on it or on the index of its write-ahead log.

    Read in the kernel's list of locks: to ask through the file, it would have to be opened, and closing it again would free all
    locks that this process itself has on it. The list names inodes; that it is our file's is asked of the process.
    """
    locks = Path("/proc/locks")
    if not locks.is_file():  # some sandboxes have none
        return []
    files = [path for path in (database, database.with_name(f"{database.name}-shm")) if path.exists()]
    inodes = {str(path.stat().st_ino) for path in files}
    found = []
    for line in locks.read_text().splitlines():
        _, kind, _, mode, pid, place, *_ = line.replace("->", "").split()
        if (kind, mode) == ("POSIX", "WRITE") and place.rpartition(":")[2] in inodes and _has_open(int(pid), files):
            found.append(int(pid))
    return found


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


def _has_open(pid: int, files: Sequence[Path]) -> bool:
    """Whether a process, one of this user, has one of these files open."""
    try:
        links = [link for link in Path(f"/proc/{pid}/fd").iterdir() if link.exists()]
        return any(link.samefile(file) for link in links for file in files)
    except (FileNotFoundError, PermissionError, ProcessLookupError):
        return False


def _is_task(pid: int) -> bool:
    """Whether a process carries out a task: it leads a process group of its own."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return b"jobs.child" in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0") and os.getpgid(pid) == pid
    return False
