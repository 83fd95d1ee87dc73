"""`luxmeter compare`: what changed between two evaluations or runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from jobs.errors import RequestError, one_line
from jobs.store import Store
from reports.change import Comparison
from reports.runs import runs_folder
from service.options import Json
from service.output import console, print_json, print_table


def compare(
    before: Annotated[str, typer.Argument(metavar="A", help="Earlier evaluation or run: a folder, or a nightly run's id.")],
    after: Annotated[str, typer.Argument(metavar="B", help="Later evaluation or run.")],
    out: Annotated[Path | None, typer.Option(help="Folder for a page that shows the changes; new or empty.")] = None,
    json: Json = False,
) -> int:
    """Compare two evaluations or nightly runs, row by row. Exit code 1 when B is worse beyond noise or newly fails."""
    from reports import regression, regression_page
    from service.output import check_free, staged

    folders = run_folder(before), run_folder(after)
    if out is not None:
        check_free(out, force=False)
    try:
        comparison = regression.compare(*folders)
    except FileNotFoundError as error:
        raise RequestError(str(error)) from None
    except ValidationError as error:
        raise RequestError(f"not an evaluation of this version: {one_line(error)}") from None
    if out is not None:
        with staged(out, force=False) as stage:
            regression_page.write(comparison, *folders, stage)
    if json:
        print_json(comparison.model_dump(mode="json"))
    else:
        print_comparison(comparison)
        if out is not None:
            print(out / "index.html")
    return int(comparison.regressed)


def run_folder(text: str) -> Path:
    """The folder that a path or a nightly run's id names. Raises RequestError where there is none."""
    dated = runs_folder(Store().home) / text
    for path in (Path(text), dated):
        if path.is_dir():
            return path
    raise RequestError(f"no folder {text}, and no nightly run of that name")


def print_comparison(comparison: Comparison) -> None:
    """The outcome in one line, then a line per row that isn't unchanged."""
    from reports.regression_page import headline

    print(headline(comparison))
    counts = ", ".join(f"{count} {verdict}" for verdict, count in comparison.counts.items())
    console.print(
        f"{counts or 'no rows'}; {comparison.tests} tests at a family-wise level of {comparison.level:g}", highlight=False
    )
    rows = [(row.verdict, row.scene, row.label, row.reasons[0] if row.reasons else "") for row in comparison.rows]
    rows += [(r.verdict, r.scene, f"reference, {r.transport}", r.reason) for r in comparison.references]
    told = [row for row in rows if row[0] not in ("unchanged", "new")]
    if told:
        print_table(("verdict", "scene", "row", ""), told)
