"""How soon the service is ready, how long submissions take while renders run, and a page of a long history:
`python -m benchmarks.service [ready|submissions|page]`.

Of a service with one more worker, in a temporary folder. The renders are two of path tracing, longer than the submissions take.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path

import httpx
import numpy as np
import sqlalchemy as sa

from jobs.database import EVALUATIONS, NODES
from jobs.queue import JobQueue
from jobs.request import EvaluationRequest

ROOT = Path(__file__).parents[1]
CLIENTS, SUBMISSIONS, RENDERS, HISTORY = 20, 200, 2, 10_000
PATIENCE_S = 180.0


def request(number: int) -> dict[str, object]:
    """A small request like no other."""
    methods = [{"name": "ir", "sweep": {"vpls": [256, 512]}}]
    return {"scenes": ["cornell-box"], "methods": methods, "size": [8, 6 + number]}


@contextmanager
def process(arguments: list[str], folder: Path, database: str) -> Iterator[subprocess.Popen[bytes]]:
    """`luxmeter ARGUMENTS` on a data folder of its own while the block runs; what it says goes to a file there."""
    folder.mkdir(parents=True, exist_ok=True)
    env = os.environ | {"LUXMETER_HOME": str(folder), "LUXMETER_DATABASE": database, "LUXMETER_STORE": str(folder.parent / "store")}
    with (folder / "log").open("wb") as log:
        found = subprocess.Popen([sys.executable, "-m", "service", *arguments], cwd=ROOT, env=env, stdout=log, stderr=log)
        try:
            yield found
        finally:
            found.send_signal(signal.SIGTERM)
            found.wait(PATIENCE_S)


def until(ready: Callable[[], bool]) -> None:
    """Return once it is ready; a service that does not answer is not. Raises TimeoutError."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            if ready():
                return
        except httpx.TransportError:
            pass
        time.sleep(0.05)
    raise TimeoutError(f"not within {PATIENCE_S:g} s")


@contextmanager
def team(folder: Path) -> Iterator[tuple[str, int]]:
    """Address and process id of a service with two workers, which have data folders of their own: neither waits for the other's
    renders."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    database = f"sqlite:///{folder / 'queue.sqlite'}"
    serve = ["serve", "--port", str(port), "--request-rate", "0", "--submission-rate", "0"]  # all clients share one address
    with process(serve, folder / "one", database) as service, process(["worker"], folder / "two", database):
        until(lambda: httpx.get(f"http://127.0.0.1:{port}/healthz").status_code == 200)
        yield f"http://127.0.0.1:{port}", service.pid


def start_renders(address: str) -> None:
    """Submit renders of path tracing for all workers; return when all run."""
    methods = [{"name": "pt", "settings": {"spp": 65_536}}]
    for seeds in range(1, RENDERS + 1):
        asked = {"scenes": ["cornell-box"], "methods": methods, "size": [320, 180], "noise": 1.0, "seeds": seeds, "priority": 0}
        httpx.post(f"{address}/v1/evaluations", json=asked, timeout=60).raise_for_status()
    until(lambda: renders() >= RENDERS)


def renders() -> int:
    """How many children of any worker have rendered for two seconds of processor time."""
    found = 0
    for path in Path("/proc").glob("[0-9]*"):
        try:
            command, spent = (path / "cmdline").read_bytes(), processor_seconds(int(path.name), ended=False)
        except (FileNotFoundError, ProcessLookupError):
            continue
        found += b"jobs.child" in command and spent > 2
    return found


def processor_seconds(pid: int, ended: bool = True) -> float:
    """Of a process, and of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11 : 15 if ended else 13])) / os.sysconf("SC_CLK_TCK")


def submit_all(
    address: str, clients: int, count: int, body: Callable[[int], dict[str, object]] = request
) -> list[tuple[int, float, str]]:
    """Submissions of that many clients at once: status, seconds and id of each."""

    def one(number: int) -> list[tuple[int, float, str]]:
        with httpx.Client(base_url=address, timeout=60) as client:
            client.get("/healthz")  # what is timed is submitting, not connecting
            found = []
            for k in range(number, count, clients):
                start = time.perf_counter()
                answer = client.post("/v1/evaluations", json=body(k))
                found.append((answer.status_code, time.perf_counter() - start, answer.json().get("id", "")))
            return found

    with ThreadPoolExecutor(clients) as pool:
        return [entry for own in pool.map(one, range(clients)) for entry in own]


def fill(queue: JobQueue, id: str, count: int) -> None:
    """Put copies of an evaluation into the database until there are `count`."""
    row, nodes = queue.records.evaluation(id), queue.records.nodes(id, *NODES.c.keys())
    ids = [f"{k:016x}" for k in range(count - 1)]
    with queue.records.transaction() as c:
        c.execute(sa.insert(EVALUATIONS), [{**row, "id": own, "created": row["created"] - 1 - k} for k, own in enumerate(ids)])
        c.execute(sa.insert(NODES), [{**node, "evaluation": own, "state": "done"} for own in ids for node in nodes])


def ready(folder: Path) -> None:
    """Print how long it takes from an empty data folder to the checks of OpenGL and Mitsuba passed."""
    start = time.perf_counter()
    with team(folder) as (address, pid):
        until(lambda: httpx.get(f"{address}/readyz", timeout=30).status_code == 200)
        print(f"ready after {time.perf_counter() - start:.1f} s, {processor_seconds(pid):.1f} s CPU")


def submissions(folder: Path) -> None:
    """Print percentiles of the time of a submission while renders run."""
    with team(folder) as (address, _):
        start_renders(address)
        seconds = [taken for _, taken, _ in submit_all(address, CLIENTS, SUBMISSIONS)]
        still = renders()
    figures = ", ".join(f"p{share} {1000 * np.percentile(seconds, share):.0f} ms" for share in (50, 95, 99))
    print(f"{SUBMISSIONS} submissions of {CLIENTS} clients, {still} renders running: {figures}")


def page(folder: Path) -> None:
    """Print how long the queue takes for a page of 50 of many evaluations."""
    with closing(JobQueue(f"sqlite:///{folder / 'queue.sqlite'}", str(folder / "store"))) as queue:
        fill(queue, queue.submit(EvaluationRequest.model_validate(request(0))).id, HISTORY)
        seconds, cursor = [], None
        for _ in range(20):
            start = time.perf_counter()
            _, cursor = queue.list(limit=50, cursor=cursor)
            seconds.append(time.perf_counter() - start)
    print(f"a page of 50 of {HISTORY}: median {1000 * np.median(seconds):.1f} ms, slowest {1000 * max(seconds):.1f} ms")


def main() -> None:
    """Print what was asked for, by default all."""
    parts = {"ready": ready, "submissions": submissions, "page": page}
    for name in sys.argv[1:] or list(parts):
        with tempfile.TemporaryDirectory() as folder:
            parts[name](Path(folder))


if __name__ == "__main__":
    main()
