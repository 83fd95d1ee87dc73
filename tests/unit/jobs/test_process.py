"""Children: what they answer, and every way they can end."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from jobs.errors import TaskError
from jobs.process import Limits, child_environment, run_task
from jobs.tasks import FrameOutput, RenderTask
from renderers.images import read_exr
from reports.results import Result

pytestmark = [pytest.mark.usefixtures("toy_methods"), pytest.mark.gl]


def task(folder: Path, frames: int = 1, repeats: int = 1, **settings: Any) -> RenderTask:
    outputs = tuple(FrameOutput(frame=k, image=f"{k}.exr", result=f"{k}.json") for k in range(frames))
    return RenderTask(
        scene="cornell-box", scene_name="box", method="flat", label="flat", settings=settings, seed=3, size=(6, 4),
        repeats=repeats, outputs=outputs, folder=folder,
    )  # fmt: skip


def test_frames_results_and_progress(tmp_path: Path) -> None:
    seen: list[dict[str, Any]] = []
    answer = run_task(task(tmp_path, frames=2, repeats=3, level=0.25), Limits(), seen.append)
    assert (answer["frames"], answer["cached"]) == (2, False)
    assert answer["key"].startswith("render {")
    assert seen == [{"done": 1, "of": 2}, {"done": 2, "of": 2}]
    layers, attributes = read_exr(tmp_path / "1.exr")
    assert layers["beauty"].shape == (4, 6, 3)
    assert (layers["beauty"] == 0.5).all()
    assert attributes == {"scene": "box", "method": "flat", "seed": "3", "frame": "1"}
    result = Result.model_validate_json((tmp_path / "1.json").read_text())
    assert (result.scene, result.seed, result.frame, result.width, result.height) == ("box", 3, 1, 6, 4)
    assert result.settings == {"subpixels": 1, "level": 0.25, "mode": "good"}
    assert result.transport == "direct"
    assert result.counters == {"pixels": 24}
    assert [t["name"] for t in result.timings] == ["fill"]
    assert result.peak_rss_bytes > 2**20
    assert result.device["gl"]
    assert result.started <= result.finished


def test_equal_tasks_give_equal_images_and_hashes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        run_task(task(tmp_path / name, level=2), Limits(), lambda detail: None)
    assert (tmp_path / "a" / "0.exr").read_bytes() == (tmp_path / "b" / "0.exr").read_bytes()
    a, b = (Result.model_validate_json((tmp_path / n / "0.json").read_text()) for n in "ab")
    assert a.frame_hash == b.frame_hash


def test_an_exception_is_one_line_with_the_traceback_in_the_log(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match=r"^ValueError: no such colour$") as caught:
        run_task(task(tmp_path, mode="raise"), Limits(), lambda detail: None)
    assert "Traceback" in caught.value.log
    assert list(tmp_path.iterdir()) == []


def test_an_abort_names_its_signal(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match=r"^killed by SIGABRT"):
        run_task(task(tmp_path, mode="abort"), Limits(), lambda detail: None)


def test_a_hanging_child_is_killed(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match=r"^took longer than 2 s$"):
        run_task(task(tmp_path, mode="hang"), Limits(wall_s=2), lambda detail: None)


def test_a_growing_child_is_killed(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match=r"^used more than 400 MiB of memory$"):
        run_task(task(tmp_path, mode="grow"), Limits(memory_bytes=400 * 2**20), lambda detail: None)


def test_a_cancelled_child_is_killed(tmp_path: Path) -> None:
    limits = Limits()
    threading.Timer(0.5, limits.cancel.set).start()
    with pytest.raises(TaskError, match=r"^cancelled$"):
        run_task(task(tmp_path, mode="hang"), limits, lambda detail: None)


def test_children_die_with_their_parent(tmp_path: Path) -> None:
    """A parent killed without a chance to tidy up leaves no renderer behind."""
    program = (
        "import sys; from pathlib import Path; from jobs.process import *; from jobs.tasks import *;"
        "run_task(RenderTask.model_validate_json(sys.argv[1]), Limits(), lambda d: None)"
    )
    job = task(tmp_path, mode="hang").model_dump_json()
    parent = subprocess.Popen([sys.executable, "-c", program, job], env=child_environment())
    child = _child_of(parent.pid)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 10
    while _alive(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(child)


def _child_of(parent: int) -> int:
    """Process id of the first child that runs jobs.child."""
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        for text in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
            if b"jobs.child" in Path(f"/proc/{text}/cmdline").read_bytes():
                time.sleep(1.0)  # let it ask the kernel to die with its parent
                return int(text)
        time.sleep(0.05)
    raise AssertionError("the child did not start")


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z" and os.getpgid(pid) >= 0
    except (FileNotFoundError, ProcessLookupError):
        return False
