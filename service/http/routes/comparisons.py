"""Two evaluations side by side."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from service.http.access import Read
from service.http.compare import compare
from service.http.models import Comparison
from service.http.problems import documented
from service.http.site import SiteOf

router = APIRouter(prefix="/v1/comparisons", tags=["results"])
Id = Annotated[str, Query(pattern=r"^[A-Za-z0-9._-]{1,64}$", description="Id of an evaluation.")]


@router.get(
    "",
    dependencies=[Read],
    responses=documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests"),
)
def comparison(site: SiteOf, a: Id, b: Id) -> Comparison:
    """Every metric of the configurations that both evaluations have, and what changed from a to b."""
    for id in (a, b):
        site.evaluation(id)
    return compare(a, b, site.queue.results(a), site.queue.results(b))
