"""`luxmeter nightly`: render a suite, compare it with the accepted run, tell what changed."""

from __future__ import annotations

import json as json_module
import shlex
import time
import urllib.error
import urllib.parse
import urllib.request
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from jobs import Options, Plan
from jobs import evaluate as carry_out
from jobs.code import code_hash
from jobs.errors import RequestError
from jobs.files import write_model
from jobs.store import Store
from reports.change import Comparison
from reports.folder import Evaluation
from reports.runs import Baseline, BrokenBaseline, RunInfo, accepted, digest, runs_folder
from service import suite as suites
from service.commands._compare import print_comparison
from service.options import Force, Json, MaxSeconds, Memory, Quiet, Timeout, in_bytes
from service.output import check_free, console, print_json, staged
from service.progress import evaluation_progress

HOOK_SECONDS = 10.0


def nightly(
    suite: Annotated[Path, typer.Option(help="Suite to render.")] = suites.DEFAULT,
    out: Annotated[Path | None, typer.Option(help="Folder for the run; a dated one in the data folder otherwise.")] = None,
    webhook: Annotated[str | None, typer.Option(metavar="URL", help="Post the outcome there as JSON; off by default.")] = None,
    max_seconds: MaxSeconds = None,
    timeout: Timeout = 600.0,
    memory: Memory = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Render a suite, compare it with the accepted run and write a page that shows what changed. Exit code 1 on a regression."""
    from reports import regression_page

    if webhook is not None:
        check_hook(webhook)
    wanted = suites.load(suite)
    plans = wanted.plans()
    store = Store()
    folder = out or new_run_folder(store.home)
    check_free(folder, force=force)
    store.check_writable()
    baseline = _baseline(store.home, wanted.name)
    options = Options(command="luxmeter nightly", wall_s=timeout, memory_bytes=in_bytes(memory), max_seconds=max_seconds)
    with staged(folder, force=force) as stage:
        name = folder.resolve().name
        accept = shlex.join(["luxmeter", "accept", name if out is None else str(out.resolve())])
        run, comparison = _run(wanted.name, plans, stage, name, baseline, options, quiet)
        regression_page.write(comparison, Path(baseline.folder) if baseline else None, stage, stage, accept)
    if json:
        print_json({"run": run.model_dump(), "folder": str(folder), "comparison": comparison.model_dump(mode="json")})
    else:
        print_comparison(comparison)
        print(folder / "index.html")
    if webhook is not None:
        notify(webhook, run, comparison, folder)
    return int(run.regressed or (baseline is None and run.failed > 0))


def new_run_folder(home: Path) -> Path:
    """A folder named by the present second, in UTC; names sort by time."""
    return runs_folder(home) / datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")


def _baseline(home: Path, suite: str) -> Baseline | None:
    try:
        return accepted(home, suite)
    except BrokenBaseline as error:
        raise RequestError(str(error)) from None


def _run(
    suite: str, plans: dict[str, Plan], stage: Path, name: str, baseline: Baseline | None, options: Options, quiet: bool
) -> tuple[RunInfo, Comparison]:
    """Evaluate every part into `stage`, compare, write `run.json`."""
    from reports import regression

    started, clock = datetime.now(UTC), time.monotonic()
    evaluations = [_evaluate(plan, stage / part, options, quiet) for part, plan in plans.items()]
    comparison = regression.compare(Path(baseline.folder) if baseline else None, stage)
    cells = [cell for evaluation in evaluations for cell in evaluation.cells]
    run = RunInfo(
        id=name, suite=suite, started=started.isoformat(timespec="seconds"), seconds=round(time.monotonic() - clock, 1),
        code=code_hash(), digest=digest(stage), cells=len(cells), failed=sum(cell.state == "failed" for cell in cells),
        baseline=baseline.id if baseline else None, counts=comparison.counts, regressed=comparison.regressed,
    )  # fmt: skip
    write_model(stage / "run.json", run)
    return run, comparison


def _evaluate(plan: Plan, folder: Path, options: Options, quiet: bool) -> Evaluation:
    """One part. An interrupted run is no run: it ends the command, and its staged folder goes."""
    folder.mkdir()
    with evaluation_progress(plan, quiet) as progress:
        evaluation = carry_out(plan, folder, options, progress)
    if any(cell.state == "cancelled" for cell in evaluation.cells):
        raise typer.Abort
    for cell in evaluation.cells:
        if cell.state == "failed":
            console.print(f"failed: {cell.id}: {cell.error}", markup=False, highlight=False)
    return evaluation


def check_hook(url: str) -> None:
    """Raises RequestError unless the address is one of http or https."""
    parts = urllib.parse.urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise RequestError(f"--webhook takes an http or https address (got {url!r})")


def message(run: RunInfo, comparison: Comparison, folder: Path) -> dict[str, Any]:
    """What the hook gets: the outcome, and the rows and references that need a look. `text` is what chat services show."""
    from reports.regression_page import headline

    grave = [row for row in comparison.rows if row.verdict in ("regression", "failed", "undecided")]
    return {
        "text": f"luxmeter {run.suite} {run.id}: {headline(comparison)}",
        "run": run.model_dump(),
        "page": str(folder / "index.html"),
        "rows": [row.model_dump(include={"part", "scene", "label", "verdict", "reasons"}) for row in grave],
        "references": [r.model_dump(include={"part", "id", "reason"}) for r in comparison.references if r.verdict == "regression"],
    }


def notify(url: str, run: RunInfo, comparison: Comparison, folder: Path) -> None:
    """Post the outcome. A hook that fails is told on stderr and changes nothing else."""
    body = json_module.dumps(message(run, comparison, folder)).encode()
    request = urllib.request.Request(url, body, {"Content-Type": "application/json", "User-Agent": "luxmeter"}, method="POST")
    try:
        with urllib.request.urlopen(request, timeout=HOOK_SECONDS):
            pass
    except (OSError, ValueError) as error:
        reason = error.reason if isinstance(error, urllib.error.URLError) else error
        console.print(f"the webhook was not reached: {reason}", markup=False, highlight=False)
