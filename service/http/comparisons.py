"""Comparisons of two runs or evaluations: made once in a limited child process, then kept under the hash of what was compared."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import reports
from reports.change import Comparison
from service.http.limited import Refused, run
from service.http.problems import Problem
from service.http.queue import Queue
from service.http.settings import GIB, ServerSettings
from service.http.sources import RETRY_S, Source

SECONDS, MEMORY = 600, 4 * GIB
MOST_KEPT, MOST_WAITING = 64, 16
KEY = re.compile(r"[0-9a-f]{32}")
FILE = re.compile(r"assets/(data|thumbnails)/[A-Za-z0-9_-]+\.(js|png)")


@dataclass(frozen=True)
class Made:
    """A comparison that is there. viewers: what `reports.regression_page.context` wants to know of the images."""

    key: str
    comparison: Comparison
    viewers: dict[str, Any]

    @property
    def assets(self) -> str:
        """Address below which the images lie."""
        return f"/v1/comparisons/{self.key}/assets"


class _Making:
    """One comparison under way: done once `ended` is set, with `error` where it failed."""

    def __init__(self) -> None:
        self.ended, self.error = threading.Event(), ""


class Comparisons:
    """A folder of comparisons, the latest 64. One is made at a time."""

    def __init__(self, settings: ServerSettings, queue: Queue) -> None:
        self.folder, self.queue = settings.home / "comparisons", queue
        self._under_way: dict[str, _Making] = {}
        self._lock, self._one = threading.Lock(), threading.Lock()

    def made(self, before: Source | None, after: Source, wait_s: float) -> Made:
        """The comparison, made now if need be. Raises Problem where that fails, or takes longer than `wait_s`: it goes on then."""
        key = _key(before, after)
        if not (self.folder / key).is_dir():
            making = self._make(key, before, after)
            if not making.ended.wait(wait_s):
                raise Problem("not-ready", "the comparison is being made", {"retry-after": RETRY_S})
            if making.error:
                raise Problem("conflict", making.error)
        return _read(self.folder / key)

    def file(self, key: str, path: str) -> Path | None:
        """An image of a comparison that was made; None where there is none."""
        if not KEY.fullmatch(key) or not FILE.fullmatch(path):
            return None
        found = self.folder / key / path
        return found if found.is_file() else None

    def _make(self, key: str, before: Source | None, after: Source) -> _Making:
        with self._lock:
            making = self._under_way.get(key)
            if making is None:
                if len(self._under_way) >= MOST_WAITING:
                    raise Problem("unavailable", "other comparisons are being made", {"retry-after": RETRY_S})
                making = self._under_way[key] = _Making()
                threading.Thread(target=self._work, args=(key, before, after, making), name="compare", daemon=True).start()
        return making

    def _work(self, key: str, before: Source | None, after: Source, making: _Making) -> None:
        try:
            with self._one:
                self._write(key, before, after)
        except Refused as error:
            making.error = str(error)
        except Exception as error:  # the thread's edge: whoever waits is told, whatever went wrong
            making.error = f"the comparison failed: {type(error).__name__}"
            raise
        finally:
            with self._lock:
                self._under_way.pop(key)
            making.ended.set()

    def _write(self, key: str, before: Source | None, after: Source) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._forget_old()
        with tempfile.TemporaryDirectory(prefix=".making-", dir=self.folder) as temporary:
            out = Path(temporary, "out")
            out.mkdir()
            folders = ["" if one is None else str(self._folder(one, Path(temporary))) for one in (before, after)]
            run("service.http.comparing", [*folders, str(out)], SECONDS, MEMORY)
            if not (self.folder / key).exists():
                os.replace(out, self.folder / key)

    def _folder(self, source: Source, temporary: Path) -> Path:
        """Where the source's evaluations lie; one of the queue is fetched first."""
        if source.folder is not None:
            return source.folder
        folder = temporary / source.id
        if not folder.is_dir():
            self.queue.export(source.id, folder)
        return folder

    def _forget_old(self) -> None:
        kept = sorted(self.folder.glob("[!.]*"), key=lambda path: path.stat().st_mtime, reverse=True)
        for old in kept[MOST_KEPT - 1 :]:
            shutil.rmtree(old)


def _read(folder: Path) -> Made:
    os.utime(folder)
    comparison = Comparison.model_validate_json((folder / "comparison.json").read_text())
    return Made(folder.name, comparison, json.loads((folder / "viewers.json").read_text()))


def _key(before: Source | None, after: Source) -> str:
    parts = [_reports_hash(), *("" if one is None else f"{one.kind} {one.identity}" for one in (before, after))]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


@cache
def _reports_hash() -> str:
    """SHA-256 over the sources that make a comparison: another version compares anew."""
    digest = hashlib.sha256()
    for path in sorted(Path(reports.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
