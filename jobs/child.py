"""What runs in a child process: `python -m jobs.child TASK ANSWER PROGRESS_FD PARENT`.

Reads the task, dies with its parent, carries the task out and writes the answer as JSON: what the task returns, or `error` in one
line (the traceback goes to standard error). Progress goes as one JSON object a line to the given file descriptor.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from jobs.errors import describe
from jobs.files import write_text
from jobs.points import reach
from jobs.tasks import AnyTask, ClaimTask, PilotTask, RenderTask, Task

PR_SET_PDEATHSIG = 1
Progress = Callable[[dict[str, Any]], None]


def main(arguments: list[str]) -> int:
    """Exit code 0 when the task was done, 1 when it failed."""
    task_file, answer_file, progress_fd, parent = arguments
    die_with(int(parent))
    task: AnyTask = TypeAdapter(Task).validate_json(Path(task_file).read_text())
    with open(int(progress_fd), "w", buffering=1) as stream:
        try:
            answer = carry_out(task, lambda event: print(json.dumps(event), file=stream))
        except Exception as error:  # the process's edge: every failure becomes the cell's error
            traceback.print_exc()
            answer = {"error": describe(error)}
    reach("child before answer")
    write_text(Path(answer_file), json.dumps(answer))
    reach("child after answer")
    return 1 if "error" in answer else 0


def carry_out(task: AnyTask, progress: Progress) -> dict[str, Any]:
    """Do the task in this process."""
    if isinstance(task, RenderTask):
        from jobs.rendering import render

        return render(task, progress)
    if isinstance(task, PilotTask):
        from jobs.rendering import run_pilot

        return run_pilot(task)
    if isinstance(task, ClaimTask):
        from jobs.reproducing import reproduce

        return reproduce(task, progress)
    from jobs.referencing import reference

    return reference(task, progress)


def die_with(parent: int) -> None:
    """Have the kernel kill this process when the parent's thread that started it ends; leave at once where it has ended already."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit("the parent process is gone")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
