"""What processes that are killed leave on this machine, outside queue and store, and its removal.

Nothing is removed that a live process may be at: databases of commands are held by a lock, folders of work name their process, and
files that are being written are young.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jobs.machine import only_one

DAY_S = 86_400.0
RUN_DAYS = 7.0
FILE_DAYS = 2.0
WRITTEN = ("references", "exposures")  # folders of the data folder in which files are written under hidden names first


@contextmanager
def work_folder() -> Iterator[Path]:
    """A temporary folder of this process, gone when the block ends."""
    with tempfile.TemporaryDirectory(prefix=f"luxmeter-{os.getpid()}-") as folder:
        yield Path(folder)


def clean_up_machine(home: Path, now: float | None = None) -> list[Path]:
    """Remove what killed processes left in this data folder and in the folder for temporary files; what was removed."""
    moment = time.time() if now is None else now
    doomed = [path for name in WRITTEN for path in (home / name).glob(".*") if _older(path, moment - FILE_DAYS * DAY_S)]
    doomed += [path for path in _dead_folders() if _older(path, moment - FILE_DAYS * DAY_S)]
    for path in doomed:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    return doomed + _clean_up_runs(home / "runs", moment - RUN_DAYS * DAY_S)


def _clean_up_runs(folder: Path, before: float) -> list[Path]:
    """Remove databases of commands that were killed and never repeated."""
    removed = []
    for path in sorted(folder.glob("*.sqlite")):
        with only_one(path.with_suffix(".lock")) as ours:
            if ours and _older(path, before):
                for suffix in ("", "-wal", "-shm"):
                    path.with_name(path.name + suffix).unlink(missing_ok=True)
                removed.append(path)
    return removed


def _dead_folders() -> Iterator[Path]:
    """Folders of work whose process is gone and that are ours to remove."""
    for path in Path(tempfile.gettempdir()).glob("luxmeter-*"):
        named = re.fullmatch(r"luxmeter-(\d+)-\w+", path.name)
        if named is not None and not Path("/proc", named[1]).exists() and path.is_dir() and path.stat().st_uid == os.getuid():
            yield path


def _older(path: Path, moment: float) -> bool:
    try:
        return path.stat().st_mtime < moment
    except FileNotFoundError:  # its process has just finished it
        return False
