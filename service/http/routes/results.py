"""Results of one evaluation as JSON, CSV or Parquet."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Header
from starlette.responses import Response

from reports.folder import Cell, Evaluation
from reports.results import Result
from service.http.access import Read
from service.http.models import ResultList
from service.http.negotiation import choose
from service.http.problems import documented
from service.http.queue import Status
from service.http.routes.evaluations import Id
from service.http.site import SiteOf

router = APIRouter(prefix="/v1/evaluations", tags=["results"])
JSON, CSV, PARQUET = "application/json", "text/csv", "application/vnd.apache.parquet"
BINARY = {"schema": {"type": "string", "format": "binary"}}


@router.get(
    "/{id}/results",
    dependencies=[Read],
    response_model=None,
    responses={
        200: {
            "description": "What is there so far: one row for each finished cell; CSV and Parquet have a row for every cell.",
            "content": {
                JSON: {"schema": {"$ref": "#/components/schemas/ResultList"}},
                CSV: {"schema": {"type": "string"}},
                PARQUET: BINARY,
            },
        },
        **documented("unauthorized", "forbidden", "not-found", "not-acceptable", "validation-failed", "too-many-requests"),
    },
)
def results(site: SiteOf, id: Id, accept: Annotated[str | None, Header()] = None) -> Response:
    """Metrics, timings, counters and hashes of every cell."""
    kind = choose(accept, (JSON, CSV, PARQUET))
    status = site.evaluation(id)
    found = site.queue.results(id)
    if kind == JSON:
        return Response(ResultList(id=id, state=status.state, results=list(found)).model_dump_json(), media_type=JSON)
    suffix = "csv" if kind == CSV else "parquet"
    headers = {"content-disposition": f'attachment; filename="{id}.{suffix}"'}
    return Response(table(status, found, suffix), media_type=kind, headers=headers)


def table(status: Status, results: Sequence[Result], suffix: str) -> bytes:
    """The table that reports write as results.csv and results.parquet."""
    from reports.tables import frame

    cells = list(status.cells)
    evaluation = Evaluation(id=status.id, created=str(status.created), request={}, scenes=[], cells=cells)
    by_key = {_of_result(result): result for result in results}
    matched = {cell.id: by_key[_of_cell(cell)] for cell in cells if _of_cell(cell) in by_key}
    data, out = frame(evaluation, matched), io.BytesIO()
    if suffix == "csv":
        data.to_csv(out, index=False)
    else:
        data.to_parquet(out, index=False)
    return out.getvalue()


def _of_cell(cell: Cell) -> tuple[object, ...]:
    return cell.scene, cell.label, cell.seed, cell.frame, cell.width, cell.height


def _of_result(result: Result) -> tuple[object, ...]:
    return result.scene, result.label, result.seed, result.frame, result.width, result.height
