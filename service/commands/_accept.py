"""`luxmeter accept`: make a run the baseline that later nightly runs are compared with."""

from __future__ import annotations

from typing import Annotated

import typer

from jobs.errors import RequestError
from jobs.store import Store
from reports.runs import BrokenBaseline
from reports.runs import accept as make_baseline
from service.commands._compare import run_folder
from service.options import Json
from service.output import print_json


def accept(
    run: Annotated[str, typer.Argument(metavar="RUN", help="A nightly run: its id, or its folder.")],
    json: Json = False,
) -> None:
    """Make a nightly run the baseline of its suite; its hash is recorded, and checked before every comparison."""
    try:
        baseline = make_baseline(Store().home, run_folder(run))
    except FileNotFoundError:
        raise RequestError(f"{run} is no nightly run: it has no run.json") from None
    except BrokenBaseline as error:
        raise RequestError(str(error)) from None
    if json:
        print_json(baseline.model_dump())
    else:
        print(f"{baseline.suite}: later runs are compared with {baseline.id} ({baseline.digest[:12]})")
