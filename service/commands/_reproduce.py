"""`luxmeter reproduce`: published tables and figures measured anew, printed side by side with what was published."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from jobs.claims import Answer, get_claim, registered_claims
from jobs.errors import RequestError, TaskError
from jobs.machine import use_of
from jobs.process import Limits, run_task
from jobs.store import Store
from jobs.tasks import ClaimTask
from service.options import Json, Memory, Quiet, in_bytes
from service.output import console, print_json, print_table
from service.progress import task_progress

HALF_AN_HOUR = 1800.0


def reproduce(
    claims: Annotated[list[str] | None, typer.Argument(metavar="CLAIM…", help="Published tables and figures, see --list.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Every claim there is.")] = False,
    listing: Annotated[bool, typer.Option("--list", help="List the claims and measure nothing.")] = False,
    timeout: Annotated[float, typer.Option(min=0.1, metavar="SECONDS", help="Limit of each claim.")] = HALF_AN_HOUR,
    memory: Memory = None,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Measure published CLAIMs anew, print published and measured figures side by side. Exit code 1 where one wasn't answered."""
    if listing:
        _print_list(json)
        return 0
    ids = _asked(claims or [], everything)
    store = Store()
    store.check_writable()
    answers = []
    for number, id in enumerate(ids, 1):
        _say(f"{id} ({number} of {len(ids)}): {get_claim(id).title}", quiet)
        answer = _answered(id, store, Limits(timeout, in_bytes(memory)), quiet)
        if answer is None:
            continue
        answers.append(answer)
        if not json:
            _print_answer(answer)
    if json:
        print_json([answer.model_dump(mode="json") for answer in answers])
    return 0 if len(answers) == len(ids) else 1


def _asked(claims: list[str], everything: bool) -> list[str]:
    """Ids to measure, each once. Raises RequestError for none, for an unknown one, and for names beside --all."""
    if everything:
        if claims:
            raise RequestError("give names of claims or --all, not both")
        return list(registered_claims())
    if not claims:
        raise RequestError(f"which claim? --all, or some of {', '.join(registered_claims())}")
    return [get_claim(id).id for id in dict.fromkeys(claims)]


def _answered(id: str, store: Store, limits: Limits, quiet: bool) -> Answer | None:
    """The answer, measured in a child process that has the machine for itself; None, said on stderr, where there is none."""
    try:
        with task_progress(id, quiet) as progress, use_of(store.home / "machine", alone=True, stop=lambda: None):
            return Answer.model_validate(run_task(ClaimTask(claim=id), limits, progress))
    except TaskError as error:
        sys.stderr.write(error.log)
        console.print(f"{id}: not answered: {error}", markup=False, highlight=False)
        return None


def _say(line: str, quiet: bool) -> None:
    if not quiet:
        console.print(line, markup=False, highlight=False)


def _print_list(json: bool) -> None:
    found = list(registered_claims().values())
    if json:
        print_json([{"claim": c.id, "title": c.title, "source": c.source} for c in found])
    else:
        print_table(("claim", "", "source"), [(c.id, c.title, c.source) for c in found])


def _print_answer(answer: Answer) -> None:
    print(f"{answer.claim}: {answer.status}\n{answer.why}\nscene: {answer.scene}\ndevice: {answer.device}\n")
    columns = ("row", "quantity", "unit", "published", "measured", "95 % from", "to")
    print_table(columns, [(r.id, r.quantity, r.unit, *map(_figure, (r.published, r.measured, r.low, r.high))) for r in answer.rows])
    print()


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
