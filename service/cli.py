"""The `luxmeter` command line. Exit codes: 0 all done, 1 some of it failed, 2 bad usage or input (one line, no traceback)."""

from __future__ import annotations

import signal
import sys
from typing import Annotated

import typer
from typer.exceptions import TyperException

from jobs.code import installed
from jobs.errors import RequestError, TaskError
from renderers import SceneError, UnknownMethod, UnsupportedScene
from service.commands._accept import accept
from service.commands._compare import compare
from service.commands._doctor import doctor
from service.commands._evaluate import evaluate
from service.commands._methods import methods
from service.commands._nightly import nightly
from service.commands._reference import reference
from service.commands._remote import cancel, fetch, retry, status, submit
from service.commands._render import render
from service.commands._reproduce import reproduce
from service.commands._scenes import scenes
from service.commands._serve import serve, worker
from service.commands._token import token
from service.errors import ServiceError
from service.output import print_json


def _version(asked: bool) -> None:
    if asked:
        print(f"luxmeter {installed('luxmeter')}")
        raise typer.Exit


app = typer.Typer(name="luxmeter", add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.callback()
def luxmeter(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_version, help="Print the version.")] = False,
) -> None:
    """Measure real-time global illumination and soft shadows against path-traced truth."""


for command in (
    doctor, scenes, methods, render, reference, evaluate, reproduce, nightly, compare, accept,
    serve, worker, submit, status, cancel, retry, fetch,
):  # fmt: skip
    app.command()(command)
app.add_typer(token)


def run(arguments: list[str]) -> int:
    """Carry out one command line (without the program's name); returns its exit code."""
    try:
        code = app(arguments or ["--help"], prog_name="luxmeter", standalone_mode=False)
    except TyperException as error:
        return _refuse(error.format_message(), arguments, 2)
    except (RequestError, SceneError, UnknownMethod, UnsupportedScene) as error:
        return _refuse(str(error), arguments, 2)
    except ServiceError as error:
        return _refuse(str(error), arguments, 1)
    except TaskError as error:
        sys.stderr.write(error.log)
        return _refuse(str(error), arguments, 1)
    except typer.Abort:
        return _refuse("interrupted", arguments, 130)
    return int(code or 0)


def main() -> None:
    """Entry point of the `luxmeter` script. A polite kill ends the work as Ctrl-C does."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(run(sys.argv[1:]))


def _refuse(message: str, arguments: list[str], code: int) -> int:
    """Say what is wrong in one line on stderr, and as JSON on stdout where JSON was asked for."""
    line = " ".join(message.split())
    print(f"luxmeter: {line}", file=sys.stderr)
    if "--json" in arguments:
        print_json({"error": line})
    return code
