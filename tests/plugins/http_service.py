"""A service on a real socket over an in-memory queue, for tests of the HTTP interface."""

from __future__ import annotations

import base64
import hashlib
import io
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import uvicorn
from fastapi import FastAPI

from jobs import plan
from jobs.doctor import Check
from jobs.request import EvaluationRequest
from reports.folder import Cell, Evaluation, SceneInfo
from reports.results import Result

HEALTHY = (Check("OpenGL 4.3", True, True, "llvmpipe", ""),)


@dataclass(frozen=True)
class FakeStatus:
    """What the HTTP interface reads of an evaluation."""

    id: str
    state: str
    created: str
    request: EvaluationRequest
    cells: tuple[Cell, ...]
    finished: str | None = None
    error: str | None = None

    @property
    def progress(self) -> dict[str, int]:
        return {"done": sum(c.state == "done" for c in self.cells), "total": len(self.cells)}


@dataclass
class FakeQueue:
    """Plans as the real one does; nothing is rendered, tests say what happens. `finish_at_once` ends evaluations as they come."""

    finish_at_once: bool = False
    found: dict[str, FakeStatus] = field(default_factory=dict)
    told: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    folders: dict[str, Path] = field(default_factory=dict)
    artifacts: dict[str, bytes] = field(default_factory=dict)
    submissions: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def submit(self, request: EvaluationRequest, priority: int = 5) -> FakeStatus:
        planned = plan(request)
        with self.lock:
            self.submissions += 1
            if planned.id not in self.found:
                created = f"2026-01-02T03:04:{len(self.found):02d}Z"
                self.found[planned.id] = FakeStatus(planned.id, "queued", created, planned.request, tuple(planned.cells))
                self.tell(planned.id, state="queued")
        if self.finish_at_once:
            self.set(planned.id, "done")
        return self.found[planned.id]

    def status(self, id: str) -> FakeStatus:
        return self.found[id]

    def list(self, state: str | None = None, limit: int = 50, cursor: str | None = None) -> tuple[list[FakeStatus], str | None]:
        newest = sorted(self.found.values(), key=lambda s: (s.created, s.id), reverse=True)
        wanted = [s for s in newest if state is None or s.state == state]
        if cursor is not None:
            try:
                after = tuple(base64.urlsafe_b64decode(cursor).decode().split(" "))
            except ValueError:
                raise ValueError("not a cursor") from None
            wanted = [s for s in wanted if (s.created, s.id) < after]
        page = wanted[:limit]
        more = len(wanted) > limit
        return page, base64.urlsafe_b64encode(f"{page[-1].created} {page[-1].id}".encode()).decode() if more else None

    def events(self, id: str, after: int = 0) -> list[dict[str, Any]]:
        return [event for event in self.told[id] if event["seq"] > after]

    def cancel(self, id: str) -> FakeStatus:
        return self.set(id, "cancelled")

    def retry(self, id: str) -> FakeStatus:
        return self.set(id, "queued")

    def report_file(self, id: str, path: str) -> bytes | None:
        folder = self.folders.get(id)
        file = folder / path if folder else None
        return file.read_bytes() if file and file.is_file() else None

    def results(self, id: str) -> list[Result]:
        return [result(cell) for cell in self.found[id].cells if cell.state == "done"]

    def export(self, id: str, folder: Path) -> None:
        if id in self.folders:
            shutil.copytree(self.folders[id], folder)
            return
        status = self.found[id]
        (folder / "results").mkdir(parents=True)
        scenes = [SceneInfo(name=name, hash="0" * 64) for name in dict.fromkeys(cell.scene for cell in status.cells)]
        whole = Evaluation(id=id, created=status.created, request={}, scenes=scenes, cells=list(status.cells))
        (folder / "evaluation.json").write_text(whole.model_dump_json())
        for cell in status.cells:
            if cell.state == "done":
                (folder / "results" / f"{cell.id}.json").write_text(result(cell).model_dump_json())

    def artifact(self, hash: str) -> tuple[BinaryIO, int] | None:
        content = self.artifacts.get(hash)
        return None if content is None else (io.BytesIO(content), len(content))

    def stats(self) -> dict[str, Any]:
        queued = sum(s.state == "queued" for s in self.found.values())
        return {
            "queues": {"gl": {"queued": queued, "running": 0, "oldest_s": 1.5 if queued else None}},
            "failures": {"timeout": 2},
            "seconds": {"ir": {"render": 12.5}},
            "clashes": 0,
        }

    def tell(self, id: str, **event: Any) -> None:
        told = self.told.setdefault(id, [])
        told.append({"seq": len(told) + 1, **event})

    def set(self, id: str, state: str, only: int | None = None) -> FakeStatus:
        """Put the evaluation into a state, and all its cells, or of them only one."""
        status = self.found[id]
        chosen = [only is None or k == only for k in range(len(status.cells))]
        cells = tuple(c.model_copy(update={"state": state}) if yes else c for c, yes in zip(status.cells, chosen, strict=True))
        whole = state if only is None else "running"
        self.found[id] = replace(status, cells=cells, state=whole, finished="2026-01-02T04:00:00Z" if whole == "done" else None)
        self.tell(id, state=whole)
        return self.found[id]

    def keep(self, content: bytes) -> str:
        hash = hashlib.sha256(content).hexdigest()
        self.artifacts[hash] = content
        return hash


def result(cell: Cell) -> Result:
    """A result that fits the cell."""
    metrics = {"rmse": 3.5 + cell.seed, "ssim": 0.98, "over_2pct": 0.1, "mean_bias": -0.01}
    return Result(
        scene=cell.scene, scene_hash="0" * 64, method=cell.method, label=cell.label, settings=cell.settings, settings_hash="1" * 64,
        seed=cell.seed, frame=cell.frame, width=cell.width, height=cell.height, transport=cell.transport,
        metrics={"matched": metrics, "full": metrics},
        timings=[{"name": "shade", "wall_s": 0.25, "cpu_s": 0.5, "gpu_s": None, "calls": 1, "stage": "render"}],
        counters={"rays": 768},
    )  # fmt: skip


@contextmanager
def serving(app: FastAPI) -> Iterator[str]:
    """Serve the application on a free port of this machine; yields its address."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        config = uvicorn.Config(
            app, log_config=None, access_log=False, server_header=False, lifespan="off", timeout_graceful_shutdown=2
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        end = time.monotonic() + 20
        while not server.started and time.monotonic() < end:
            time.sleep(0.01)
        assert server.started
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(10)
