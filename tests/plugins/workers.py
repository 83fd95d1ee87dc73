"""Workers that tests start, kill and stop. A server imports everything once and forks a worker for each request, which takes 0.1 s.

The server is `python workers.py`; one JSON object a line on its standard input says what to start: `Spec`. It answers the
worker's process id. Renders and references of these workers are flat images made in the worker itself, in no time, unless `real` is
asked for.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
RADIANCE = {"direct": 0.5, "full": 0.75}
BACK_OFF_S = (0.02, 0.05)  # before a crashed child is tried again, in place of seconds


@dataclass(frozen=True)
class Spec:
    """A worker: at `label`, reached for the first time, it sends itself `signal`. effects: a file that work adds lines to."""

    database: str
    home: str
    effects: str
    label: str = ""
    signal: int = signal.SIGKILL
    lease_s: float = 30.0
    real: bool = False
    submit: str = ""
    nap_s: float = 0.0
    store: str = ""


def flat(task: Any, limits: Any, progress: Any) -> dict[str, Any]:
    """Carry a task out without a child: constant images, brightness from the settings."""
    import numpy as np

    from jobs.rendering import content_hash
    from jobs.settings import settings_hash
    from jobs.tasks import ReferenceTask
    from renderers import Frame
    from renderers.images import write_exr
    from reports.folder import ReferenceInfo
    from reports.results import Result

    shape = (task.size[1], task.size[0], 3)
    if isinstance(task, ReferenceTask):
        mean = np.full(shape, RADIANCE[task.transport], np.float32)
        layers = {"mean": mean, "variance": mean * 0 + 1e-12, "luminance_variance": mean[..., 0] * 0 + np.float32(1e-12)}
        (task.folder / task.image).parent.mkdir(parents=True, exist_ok=True)
        write_exr(task.folder / task.image, layers, n="16", spp="64")
        info = ReferenceInfo(
            id=task.id, scene=task.scene_name, frame=task.frame, transport=task.transport, pixel=task.pixel, noise=1e-6,
            asked=task.noise, replicates=16, spp=64, seconds=0.1, content_hash="0",
        )  # fmt: skip
        return {"info": info.model_dump(), "scene_hash": "box", "exposure": 1.0}
    for output in task.outputs:
        frame = Frame({"beauty": np.full(shape, task.settings["level"], np.float32)}, counters={"pixels": shape[0] * shape[1]})
        (task.folder / output.image).parent.mkdir(parents=True, exist_ok=True)
        (task.folder / output.result).parent.mkdir(parents=True, exist_ok=True)
        write_exr(task.folder / output.image, frame.layers, "beauty")
        result = Result(
            scene=task.scene_name, scene_hash="box", method=task.method, label=task.label, settings=task.settings,
            settings_hash=settings_hash(task.settings), seed=task.seed, frame=output.frame, width=task.size[0], height=task.size[1],
            transport="direct", counters=dict(frame.counters), frame_hash=content_hash(frame), run=task.run,
            timings=[{"name": "fill", "wall_s": 0.01, "cpu_s": 0.01, "gpu_s": None, "calls": 1, "stage": "render"}],
        )  # fmt: skip
        (task.folder / output.result).write_text(result.model_dump_json())
    key = json.dumps([task.scene, task.settings, task.seed, task.size, [o.frame for o in task.outputs]])
    return {"frames": len(task.outputs), "key": f"render {key}", "cached": False}


def half_real(task: Any, limits: Any, progress: Any) -> dict[str, Any]:
    """Carry a task out: renders in children as ever, references as above."""
    from jobs.process import run_task
    from jobs.tasks import ReferenceTask

    return (flat if isinstance(task, ReferenceTask) else run_task)(task, limits, progress)


def stopped() -> Exception:
    """What a child that was told to stop ends with."""
    from jobs.errors import TaskError

    return TaskError("cancelled", failure="cancelled")


def quick_report(folder: Path) -> Path:
    """A page that says how many results there are."""
    from reports.folder import read

    evaluation, results = read(folder)
    page = folder / "index.html"
    page.write_text(f"{len(results)} results, {[cell.state for cell in evaluation.cells]}")
    return page


def run(spec: Spec) -> None:
    """Be the worker."""
    import reports
    from jobs import points, work
    from jobs.process import run_task
    from jobs.store import Store

    reports.write = quick_report
    work.BACK_OFF_S = BACK_OFF_S
    reached = threading.Lock()

    def hook(label: str) -> None:
        if label == spec.label and reached.acquire(blocking=False):
            note(spec, f"reached {label}")
            os.kill(os.getpid(), spec.signal)
            time.sleep(0.2)  # a stop takes effect in all threads before this one goes on

    def runner(task: Any, limits: Any, progress: Any) -> dict[str, Any]:
        note(spec, f"start {task.kind}")
        time.sleep(spec.nap_s)
        answer = (run_task if spec.real and task.kind == "render" else flat)(task, limits, progress)
        note(spec, f"end {task.kind}")
        return answer

    points.hook = hook
    os.environ["LUXMETER_HOME"] = spec.home
    if spec.submit:
        from jobs.queue import JobQueue
        from jobs.request import EvaluationRequest

        queue = JobQueue(spec.database)
        print(queue.submit(EvaluationRequest.model_validate_json(spec.submit)).id, flush=True)
        return
    from jobs.worker import Worker

    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: stop.set())
    worker = Worker(
        spec.database, spec.store or None, lease_s=spec.lease_s, poll_s=0.05, runner=runner, home=Store(Path(spec.home))
    )
    note(spec, "worker up")
    worker.run(stop)
    note(spec, "worker down")


def note(spec: Spec, line: str) -> None:
    """Add a line to the effects, in one write."""
    handle = os.open(spec.effects, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    os.write(handle, f"{line}\n".encode())
    os.close(handle)


class Server:
    """Forks workers. Use as a context manager; all workers end with it."""

    def __init__(self) -> None:
        self._workers: list[int] = []

    def __enter__(self) -> Server:
        path = os.pathsep.join([str(ROOT), str(ROOT / "tests" / "plugins"), os.environ.get("PYTHONPATH", "")])
        env = os.environ | {"PYTHONPATH": path, "LUXMETER_PLUGINS": "toy_methods"}
        command = [sys.executable, __file__]
        self._server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env)
        return self

    def __exit__(self, *exception: object) -> None:
        self.end_workers()
        self._server.stdin.close()
        self._server.wait(10)
        self._server.stdout.close()

    def start(self, spec: Spec) -> int:
        """Start a worker; its process id."""
        self._server.stdin.write(json.dumps(asdict(spec)) + "\n")
        self._server.stdin.flush()
        pid = int(self._server.stdout.readline())
        self._workers.append(pid)
        return pid

    def end_workers(self) -> None:
        """Kill all workers that were started."""
        for pid in self._workers:
            self.kill(pid)
        while any(map(alive, self._workers)):
            time.sleep(0.02)
        self._workers.clear()

    def kill(self, pid: int, number: int = signal.SIGKILL) -> None:
        """Signal a worker that may be gone already."""
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            return


def alive(pid: int) -> bool:
    """Whether a worker is there. One that was killed keeps its locks until its last thread has ended, and is gone then: the server
    leaves no zombies."""
    return Path(f"/proc/{pid}").exists()


def serve() -> None:
    """Fork a worker for each line of standard input."""
    import numpy as np

    import jobs.queue  # noqa: F401  (and with it all that a worker imports)
    import reports.comparison

    black = np.zeros((6, 8, 3), np.float32)
    reports.comparison.compare(black, black, 1.0, black[..., 0], 16)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            code = 1
            try:
                sys.stdin.close()
                os.dup2(2, 1)
                run(Spec(**json.loads(line)))
                code = 0
            finally:
                sys.stderr.flush()
                os._exit(code)
        print(pid, flush=True)


if __name__ == "__main__":
    serve()
