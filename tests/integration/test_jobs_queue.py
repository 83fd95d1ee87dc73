"""The queue from submission to report, with a worker in this process; renders and references are mostly stand-ins."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import workers
from waiting import finished, until

from jobs import EvaluationRequest, MethodRequest, plan, points
from jobs.errors import StoreError
from jobs.monitor import ASK_S, Monitor, Watched
from jobs.process import POLL_S, Limits, run_task
from jobs.queue import JobQueue
from jobs.retention import clean_up
from jobs.store import Store
from jobs.tasks import ReferenceTask, RenderTask
from jobs.worker import Worker

pytestmark = pytest.mark.usefixtures("toy_methods")
on_sqlite = pytest.mark.parametrize("database", ["sqlite"], indirect=True)


@pytest.fixture(autouse=True)
def _surroundings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import reports

    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(reports, "write", workers.quick_report)
    monkeypatch.setattr("jobs.work.BACK_OFF_S", workers.BACK_OFF_S)


@pytest.fixture
def queue(database: str) -> Iterator[JobQueue]:
    found = JobQueue(database)
    yield found
    found.close()


def request(level: Any = (0.5, 0.25), **changes: Any) -> EvaluationRequest:
    methods = [{"name": "flat", "sweep": {"level": list(level)}}]
    return EvaluationRequest.model_validate({"scenes": ["cornell-box"], "methods": methods, "size": [8, 6], **changes})


@contextmanager
def working(queue: JobQueue, tmp_path: Path, runner: Any = workers.flat, **options: Any) -> Iterator[Worker]:
    worker = Worker(
        queue.records.url, poll_s=0.05, runner=runner, home=Store(tmp_path / "home"), **{"cron": None, "lease_s": 20.0} | options
    )
    with worker.working():
        yield worker


def test_submit_work_report(queue: JobQueue, tmp_path: Path) -> None:
    submitted = queue.submit(request(), priority=2)
    assert (submitted.state, submitted.progress) == ("queued", {"done": 0, "total": 9})
    assert submitted.request.priority == 2
    assert queue.submit(request(), priority=7) == submitted
    assert queue.report_file(submitted.id, "index.html") is None
    assert queue.stats()["queues"]["gl"]["queued"] == 2
    with working(queue, tmp_path):
        done = finished(queue, submitted.id)
        assert len(queue.stats()["workers"]) == 1
    assert (done.state, done.error) == ("done", None)
    assert [cell.state for cell in done.cells] == ["done", "done"]
    assert [result.counters for result in queue.results(done.id)] == [{"pixels": 48}] * 2
    assert queue.report_file(done.id, "index.html") == b"2 results, ['done', 'done']"
    image = queue.report_file(done.id, f"images/{done.cells[0].id}.exr")
    assert image is not None
    assert queue.report_file(done.id, "../../etc/passwd") is None
    found = queue.artifact(next(iter(queue.records.outcomes(done.id)["report"].files.values())))
    assert found is not None
    with found[0] as stream:
        assert len(stream.read()) == found[1]
    assert queue.artifact("0" * 64) is None
    events = queue.events(done.id)
    assert [event["seq"] for event in events] == list(range(1, len(events) + 1))
    assert queue.events(done.id, after=events[-2]["seq"]) == events[-1:]
    assert (events[0]["state"], events[-1]["state"]) == ("queued", "done")
    assert queue.stats()["seconds"]["flat"]["render"] == pytest.approx(0.02)
    assert queue.stats()["workers"] == []
    assert queue.cancel(done.id).state == "done"
    assert queue.retry(done.id).state == "done"


def test_strangers_are_key_errors(queue: JobQueue) -> None:
    for ask in (queue.status, queue.events, queue.cancel, queue.retry, queue.results):
        with pytest.raises(KeyError):
            ask("nosuch")
    with pytest.raises(KeyError):
        queue.report_file("nosuch", "index.html")
    with pytest.raises(ValueError, match="not a cursor"):
        queue.list(cursor="x")


@on_sqlite
def test_pages_hold_every_evaluation_once(queue: JobQueue) -> None:
    ids = [queue.submit(request(seeds=k + 1)).id for k in range(5)]
    queue.cancel(ids[1])
    found, cursor = queue.list(limit=2)
    while cursor is not None:
        page, cursor = queue.list(limit=2, cursor=cursor)
        found += page
    assert [status.id for status in found] == ids[::-1]
    assert [status.id for status in queue.list(state="cancelled")[0]] == [ids[1]]


def test_cancelled_before_any_worker(queue: JobQueue, tmp_path: Path) -> None:
    id = queue.submit(request()).id
    assert queue.cancel(id).state == "cancelled"
    assert [cell.state for cell in queue.status(id).cells] == ["cancelled"] * 2
    with working(queue, tmp_path):
        assert finished(queue, id).state == "cancelled"
        assert queue.report_file(id, "index.html") == b"0 results, ['cancelled', 'cancelled']"
        assert queue.retry(id).state == "queued"
        assert finished(queue, id).state == "done"


def test_cancelling_ends_what_runs_at_the_next_look(queue: JobQueue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who watches the work looks several times a second; the first look after the cancel tells the work to stop."""
    started, cancelled, ended, told = threading.Event(), threading.Event(), list[str](), list[str]()
    look = Monitor._ask

    def looking(monitor: Monitor, watched: Sequence[Watched]) -> None:
        late = cancelled.is_set()
        look(monitor, watched)
        if late:
            told.extend(str(one.reason) for one in watched if not one.always)

    monkeypatch.setattr(Monitor, "_ask", looking)

    def slow(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        if not isinstance(task, RenderTask):
            return workers.flat(task, limits, progress)
        started.set()
        while not limits.cancel.is_set():
            time.sleep(POLL_S)
        ended.append(task.kind)
        raise workers.stopped()

    id = queue.submit(request()).id
    with working(queue, tmp_path, slow):
        assert started.wait(120)
        queue.cancel(id)
        cancelled.set()
        status = finished(queue, id)
    assert ASK_S + POLL_S < 1
    assert set(told) <= {"cancelled"}  # nothing, where a look that was under way had seen it already
    assert ended == ["render"]  # the second render never began
    assert [cell.state for cell in status.cells] == ["cancelled", "cancelled"]
    assert queue.report_file(id, "index.html") == b"0 results, ['cancelled', 'cancelled']"


@on_sqlite
def test_urgent_work_overtakes(queue: JobQueue, tmp_path: Path) -> None:
    """Both evaluations' renders wait while the first one runs; those of the urgent evaluation come next."""
    order, go = list[int](), threading.Event()

    def watch(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        if isinstance(task, RenderTask):
            order.append(task.size[1])
            assert go.wait(120)
        return workers.flat(task, limits, progress)

    def waiting(id: str) -> int:
        return sum(row["queue"] == "gl" and row["ready"] is not None for row in queue.records.nodes(id, "queue", "ready"))

    late = queue.submit(request([0.1, 0.2, 0.3, 0.4], size=[8, 4]), priority=8).id
    with working(queue, tmp_path, watch):
        until(lambda: order == [4], "the first render did not begin")
        soon = queue.submit(request(size=[8, 5]), priority=1).id
        until(lambda: waiting(soon) == 2 and waiting(late) == 4, "the renders are not in the queue")
        go.set()
        finished(queue, late)
        finished(queue, soon)
    assert order == [4, 5, 5, 4, 4, 4]


@on_sqlite
def test_timed_renders_have_the_machine_alone(queue: JobQueue, tmp_path: Path) -> None:
    """Whatever else runs in this data folder, in any process, waits or is waited for."""
    lock, running, together = threading.Lock(), list[str](), set[tuple[str, ...]]()

    def watch(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        with lock:
            running.append(task.kind)
            together.add(tuple(sorted(running)))
        time.sleep(0.05)
        with lock:
            running.remove(task.kind)
        return workers.flat(task, limits, progress)

    ids = [queue.submit(request(seeds=k)).id for k in (1, 2)]
    with working(queue, tmp_path, watch):
        for id in ids:
            finished(queue, id)
    assert together == {("render",), ("reference",)}


@on_sqlite
@pytest.mark.gl
def test_every_way_to_fail_is_named_and_the_queue_moves_on(queue: JobQueue, tmp_path: Path) -> None:
    wall_s = 3.0
    modes = ["segfault", "grow", "nan", "raise", "good"]
    body = request().model_dump() | {"methods": [{"name": "flat", "sweep": {"mode": modes}}]}
    hanging = plan(request().model_copy(update={"methods": [MethodRequest(name="flat", settings={"mode": "hang"})]}))

    def real(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        return (run_task if isinstance(task, RenderTask) else workers.flat)(task, limits, progress)

    id = queue.submit(EvaluationRequest.model_validate(body)).id
    queue.submit_plan(hanging, 0, queue.order(hanging, hanging.id, wall_s=wall_s))
    with working(queue, tmp_path, real, memory_bytes=400 * 2**20):
        hung, status = finished(queue, hanging.id), finished(queue, id)
    assert hung.cells[0].error == "took longer than 3 s"
    errors = {mode: cell.error or "" for mode, cell in zip(modes, status.cells, strict=True)}
    assert errors["segfault"].startswith("killed by SIGSEGV")
    assert errors["grow"] == "used more than 400 MiB of memory"
    assert errors["nan"] == "FloatingPointError: layer 'beauty' holds 3 values that are not finite"
    assert errors["raise"] == "ValueError: no such colour"
    assert errors["good"] == ""
    assert status.state == "failed"
    assert queue.stats()["failures"] == {"timeout": 1, "crash": 1, "memory": 1, "error": 2}


@on_sqlite
def test_an_equal_render_comes_from_the_cache_and_its_times_stay_apart(
    queue: JobQueue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second evaluation that shares a render takes it from the store; beside fresh renders its old timings are left out."""
    # Renders run in a worker's thread here, and an OpenGL context belongs to the thread that made it.
    for module in ("renderers.method", "jobs.rendering"):
        monkeypatch.setattr(f"{module}.device_string", lambda: "no device")
    rendered = list[float]()

    def real(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        if isinstance(task, ReferenceTask):
            return workers.flat(task, limits, progress)
        from jobs.rendering import render

        rendered.append(task.settings["level"])
        return render(task, progress)

    with working(queue, tmp_path, real):
        first = finished(queue, queue.submit(request([0.5])).id)
        again = finished(queue, queue.submit(request([0.5], noise=0.02)).id)
        mixed = finished(queue, queue.submit(request([0.5, 0.75])).id)
    one, two, (three, four) = queue.results(first.id)[0], queue.results(again.id)[0], queue.results(mixed.id)
    assert one.frame_hash == two.frame_hash == three.frame_hash != four.frame_hash
    assert one.timings == two.timings  # all of this scene's timings are of one earlier run: comparable
    assert "timed then, in one run" in two.notes[-1]
    assert three.timings == []
    assert "timings are left out" in three.notes[-1]
    assert four.timings
    assert queue.stats()["clashes"] == 0


@on_sqlite
def test_two_answers_to_one_question_are_a_determinism_failure(queue: JobQueue, tmp_path: Path) -> None:
    def fickle(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        answer = workers.flat(task, limits, progress)
        return answer if isinstance(task, ReferenceTask) else answer | {"key": "render the same"}

    with working(queue, tmp_path, fickle):
        status = finished(queue, queue.submit(request()).id)
    notes = [result.notes for result in queue.results(status.id)]
    assert sorted(len(own) for own in notes) == [0, 1]
    assert next(own[0] for own in notes if own).startswith("determinism failure")
    assert queue.stats()["clashes"] == 1


@on_sqlite
@pytest.mark.parametrize("fault", ["full", "read-only"])
def test_a_store_that_refuses_fails_clearly_and_recovers(queue: JobQueue, tmp_path: Path, fault: str) -> None:
    import errno

    number = {"full": errno.ENOSPC, "read-only": errno.EROFS}[fault]
    words = {"full": "No space left on device", "read-only": "Read-only file system"}[fault]

    def refuse(label: str) -> None:
        if label == "artifact half written":
            raise OSError(number, words)

    id = queue.submit(request()).id
    points.hook = refuse
    try:
        with pytest.raises(StoreError, match=words):
            queue.submit(request(seeds=3))
        with working(queue, tmp_path):
            status = finished(queue, id)
            assert status.state == "failed"
            assert all(words in (cell.error or "") for cell in status.cells)
            assert words in (status.error or "")
            points.hook = None
            queue.retry(id)
            assert finished(queue, id).state == "done"
    finally:
        points.hook = None
    assert not any((tmp_path / "home" / "artifacts").rglob(".*.part"))


@on_sqlite
def test_retry_makes_lost_artefacts_again(queue: JobQueue, tmp_path: Path) -> None:
    broken = True

    def once(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        if broken and isinstance(task, RenderTask) and task.settings["level"] == 0.25:
            raise RuntimeError("no")
        return workers.flat(task, limits, progress)

    with working(queue, tmp_path, once):
        id = queue.submit(request()).id
        failed = finished(queue, id)
        assert [cell.state for cell in failed.cells] == ["done", "failed"]
        lost = queue.records.outcomes(id)["reference:cornell-box.full.centre.f0000"].files.values()
        for name in lost:
            (tmp_path / "home" / "artifacts" / "sha256" / name[:2] / name).unlink()
        broken = False
        queue.retry(id)
        assert finished(queue, id).state == "done"


@on_sqlite
def test_a_worker_that_ends_leaves_its_work_to_the_next(queue: JobQueue, tmp_path: Path) -> None:
    started = threading.Event()

    def hanging(task: Any, limits: Limits, progress: Any) -> dict[str, Any]:
        started.set()
        while not limits.cancel.is_set():
            time.sleep(0.1)
        raise AssertionError("a worker that ends raises before")

    id = queue.submit(request()).id
    with working(queue, tmp_path, hanging):
        assert started.wait(120)
    assert queue.status(id).state == "running"
    with working(queue, tmp_path):
        assert finished(queue, id).state == "done"


@on_sqlite
def test_a_node_whose_worker_keeps_dying_is_given_up(queue: JobQueue, tmp_path: Path) -> None:
    spec = workers.Spec(queue.records.url, str(tmp_path / "home"), str(tmp_path / "effects"))
    (tmp_path / "effects").touch()
    planned = plan(request([0.5]))
    id = queue.submit_plan(
        planned, 0, queue.order(planned, planned.id, references_first=True)
    ).id  # so that only the render is lost
    with workers.Server() as server:
        for number in range(5):
            label = "render before commit" if number < 4 else ""
            pid = server.start(replace(spec, label=label))
            if label:
                until(lambda pid=pid: not workers.alive(pid), "the worker did not die")
        status = finished(queue, id)
    assert status.state == "failed"
    assert status.cells[0].error == "given up: the worker died each of the 4 times this was tried"
    assert queue.stats()["failures"] == {"poison": 1}


def test_retention_forgets_the_old_and_keeps_what_is_named(queue: JobQueue, tmp_path: Path) -> None:
    with working(queue, tmp_path):
        old = finished(queue, queue.submit(request([0.5])).id)
        young = finished(queue, queue.submit(request([0.25])).id)
    nothing = clean_up(queue, days=1)
    assert (nothing.evaluations, nothing.artifacts) == (0, 0)
    queue.forget(old.id)
    later = time.time() + 10 * 86400
    part = tmp_path / "home" / "artifacts" / "keys" / "ab" / ".left-by-a-kill.part"
    part.parent.mkdir(parents=True, exist_ok=True)
    part.touch()
    assert clean_up(queue, days=30).unfinished == 0
    removed = clean_up(queue, days=30, most_bytes=0, now=later)
    assert removed.unfinished == 1
    assert not part.exists()
    assert removed.artifacts > 0
    assert removed.entries > 0
    assert len(queue.results(young.id)) == 1
    with pytest.raises(KeyError):
        queue.status(old.id)
    assert clean_up(queue, days=5, most_bytes=0, now=later).evaluations == 1
    assert list(queue.artifacts.entries("sha256")) == []


@on_sqlite
def test_the_nightly_function_is_called(queue: JobQueue, tmp_path: Path) -> None:
    called = threading.Event()
    with working(queue, tmp_path, cron="* * * * * *", nightly=lambda scheduled: called.set()):
        assert called.wait(60)
