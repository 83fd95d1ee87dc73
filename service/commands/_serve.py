"""`luxmeter serve` and `luxmeter worker`: the service, and more hands for it."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from jobs.errors import RequestError
from jobs.process import child_environment
from jobs.store import Store
from service import suite as suites
from service.commands._nightly import check_hook
from service.nights import CRON, Nights, check_cron
from service.tokens import TokenStore

Suite = Annotated[
    Path | None,
    typer.Option("--nightly", envvar="LUXMETER_NIGHTLY", metavar="SUITE", help="Suite to render every night; none by default."),
]
Cron = Annotated[str, typer.Option(envvar="LUXMETER_CRON", help="When a night begins: a cron line, in UTC.")]
Webhook = Annotated[
    str | None, typer.Option(envvar="LUXMETER_WEBHOOK", metavar="URL", help="Post each night's outcome there as JSON.")
]
STOP_S = 20
GRACE_S = 3
NICER = 15  # a worker gives way to the service on the same machine; where nothing else wants to run, this changes nothing
HEADERS_KIB = 32


def serve(
    host: Annotated[str, typer.Option(help="Address to listen at; any but a loopback one needs a token.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8000,
    worker: Annotated[bool, typer.Option(help="Also run a worker, as a process of its own.")] = True,
    name: Annotated[
        list[str] | None, typer.Option(help="A name the service is reached by; others are refused. Repeat for more.")
    ] = None,
    request_rate: Annotated[float, typer.Option(min=0, help="Requests a second that one address may send; 0: any number.")] = 50,
    submission_rate: Annotated[
        float, typer.Option(min=0, help="Changes a second that one address may ask for; 0: any number.")
    ] = 2,
    nightly: Suite = None,
    cron: Cron = CRON,
    webhook: Webhook = None,
) -> None:
    """Serve HTTP and pages until interrupted. Logs go to stderr, one JSON object a line."""
    loopback = is_loopback(host)
    if not loopback and not TokenStore().all():
        raise RequestError(f"{host} is reachable from elsewhere: make a token first (luxmeter token add NAME)")
    Store().check_writable()
    nights = checked(nightly, cron, webhook)
    import uvicorn

    from jobs.queue import JobQueue
    from service.http import logs
    from service.http.app import create_app
    from service.http.settings import ServerSettings

    logs.configure()
    hosts = tuple(name) if name else ("localhost", "127.0.0.1", "::1", host) if loopback else None
    settings = ServerSettings(
        require_token=not loopback, hosts=hosts, requests_per_s=request_rate, submissions_per_s=submission_rate
    )
    app = create_app(JobQueue(), settings)
    app.state.site.health.refresh()
    config = uvicorn.Config(
        app, host=host, port=port, log_config=None, access_log=False, server_header=False, timeout_graceful_shutdown=GRACE_S,
        limit_concurrency=500, h11_max_incomplete_event_size=HEADERS_KIB * 1024, http="h11", lifespan="off",
    )  # fmt: skip
    with own_worker(nights) if worker else contextlib.nullcontext():
        uvicorn.Server(config).run()


def worker(nightly: Suite = None, cron: Cron = CRON, webhook: Webhook = None) -> None:
    """Carry out what is queued until interrupted; what is running then is taken up by another worker, or at the next start."""
    checked(nightly, cron, webhook)
    from jobs.queue import Worker
    from service.http import logs

    logs.configure()
    os.nice(NICER)
    stop = threading.Event()
    nights = Nights(nightly, Store().home, stop, webhook) if nightly is not None else None
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    Worker(nightly=nights, cron=cron).run(stop)


def checked(nightly: Path | None, cron: str, webhook: str | None) -> list[str]:
    """The options of a worker's nights, as a command line has them. Raises RequestError where one of them can't be."""
    check_cron(cron)
    if webhook is not None:
        check_hook(webhook)
    if nightly is not None:
        suites.load(nightly).plans()
    given = {"--nightly": nightly, "--cron": cron, "--webhook": webhook}
    return [text for name, value in given.items() if value is not None for text in (name, str(value))]


@contextlib.contextmanager
def own_worker(nights: Sequence[str]) -> Iterator[None]:
    """A worker beside the service, as a process of its own so that rendering never holds up an answer."""
    environment = child_environment() | {"LUXMETER_HOME": str(Store().home)}
    child = subprocess.Popen([sys.executable, "-P", "-m", "service", "worker", *nights], env=environment, stdin=subprocess.DEVNULL)
    try:
        yield
    finally:
        child.terminate()
        try:
            child.wait(STOP_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach that address. A name that isn't `localhost` may be anyone's."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
