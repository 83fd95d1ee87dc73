"""`luxmeter evaluate`: scenes × methods × settings × seeds, references, comparisons and the report."""

from __future__ import annotations

import shlex
import sys
from typing import Annotated, Any

import typer

from jobs import EvaluationRequest, Options, plan
from jobs import evaluate as carry_out
from jobs.errors import RequestError
from jobs.store import Store
from service import parse
from service.options import Force, Frames, Json, MaxSeconds, Memory, Out, Quiet, References, Size, Timeout, in_bytes
from service.output import check_free, console, print_json, staged
from service.progress import evaluation_progress


def evaluate(
    scene: Annotated[list[str], typer.Option(help="A scene; repeat for more.")],
    method: Annotated[list[str], typer.Option(help="A method; repeat for more.")],
    out: Out,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="M.K=V", help="Setting K of method M.")] = None,
    sweep: Annotated[list[str] | None, typer.Option(metavar="M.K=A,B,…", help="Render M once for each value of K.")] = None,
    seeds: Annotated[int, typer.Option(help="Seeds 0 … N-1; two or more give intervals.")] = 1,
    size: Size = "320x180",
    frames: Frames = "0:0",
    references: References = None,
    noise: Annotated[float, typer.Option(help="Wanted relative noise of the references.")] = 0.01,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="Timed renders of each cell; timings are medians.")] = 1,
    max_seconds: MaxSeconds = None,
    timeout: Timeout = None,
    memory: Memory = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Render every method on every scene, compare with path-traced references and write OUT/index.html."""
    request = build(
        scene, method, settings or [], sweep or [], size=size, seeds=seeds, frames=frames, references=references, noise=noise
    )
    planned = plan(request)
    check_free(out, force=force)
    Store().check_writable()
    options = Options(
        command=shlex.join(["luxmeter", *sys.argv[1:]]),
        repeats=repeats,
        wall_s=timeout,
        memory_bytes=in_bytes(memory),
        max_seconds=max_seconds,
    )
    with staged(out, force=force) as folder, evaluation_progress(planned, quiet) as notify:
        evaluation = carry_out(planned, folder, options, notify)
    failed = [cell for cell in evaluation.cells if cell.state != "done"]
    for cell in failed:
        console.print(f"{cell.state}: {cell.id}: {cell.error}", markup=False, highlight=False)
    if json:
        print_json(evaluation.model_dump(mode="json"))
    elif (out / "index.html").is_file():
        print(out / "index.html")
    return 1 if failed or not (out / "index.html").is_file() else 0


def build(
    scenes: list[str],
    methods: list[str],
    settings: list[str],
    sweeps: list[str],
    *,
    size: str,
    seeds: int,
    frames: str,
    references: str | None,
    noise: float,
) -> EvaluationRequest:
    """The request that the options say. Raises RequestError in one line."""
    wanted: dict[str, dict[str, Any]] = {name: {"name": name, "settings": {}, "sweep": {}} for name in methods}
    if len(wanted) < len(methods):
        raise RequestError("a method is given twice; use --sweep for several settings")
    for key, value in parse.assignments(settings).items():
        method, name = _of_method(key, wanted, "--set")
        wanted[method]["settings"][name] = value
    for key, text in parse.assignments(sweeps, "--sweep").items():
        method, name = _of_method(key, wanted, "--sweep")
        values = text if isinstance(text, list) else [parse.value(part) for part in str(text).split(",")]
        wanted[method]["sweep"][name] = values
    return parse.request(
        {
            "scenes": scenes, "methods": list(wanted.values()), "size": parse.size(size), "seeds": seeds,
            "frames": parse.frames(frames), "references": parse.references(references), "noise": noise,
        }
    )  # fmt: skip


def _of_method(key: str, wanted: dict[str, dict[str, Any]], option: str) -> tuple[str, str]:
    method, dot, name = key.partition(".")
    if not dot or method not in wanted:
        raise RequestError(f"{option} takes METHOD.setting=value with one of {', '.join(wanted)} (got {key!r})")
    return method, name
