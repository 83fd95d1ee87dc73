"""Evaluations: submit, list, read, cancel, retry."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body, Query, Request, Response
from fastapi import Path as InPath

from jobs.request import EvaluationRequest
from reports.folder import State
from service.http.access import Read, Submit
from service.http.admission import admit
from service.http.logs import EVALUATION
from service.http.models import EvaluationPage, EvaluationSummary, EvaluationView, summary, view
from service.http.problems import Problem, documented
from service.http.queue import ENDED
from service.http.site import SiteOf

router = APIRouter(prefix="/v1/evaluations", tags=["evaluations"])
Id = Annotated[str, InPath(pattern=r"^[A-Za-z0-9._-]{1,64}$", examples=["3f9a1c0b5d7e2468"])]
POLL_S = "2"
EXAMPLES = {
    "two methods": {
        "value": {
            "scenes": ["cornell-box"],
            "methods": [{"name": "ir"}, {"name": "pt", "settings": {"spp": 16}}],
            "size": [160, 90],
        }
    },
    "sweep with seeds": {
        "value": {
            "scenes": ["cornell-box", "cornell-glossy"],
            "methods": [{"name": "ir", "sweep": {"vpls": [256, 1024, 4096]}}],
            "seeds": 4,
            "noise": 0.004,
        }
    },
    "sequence": {
        "summary": "An animation: references in every 10th frame, and in two windows where flicker is measured.",
        "value": {
            "scenes": ["cube-in-a-box"],
            "methods": [{"name": "rcs"}, {"name": "pt", "settings": {"spp": 16}}],
            "size": [96, 72],
            "frames": [0, 99],
            "references": {"every": 10, "windows": [[0, 19], [80, 99]]},
        },
    },
}


@router.post(
    "",
    status_code=202,
    dependencies=[Submit],
    responses={
        202: {"headers": {"Location": {"schema": {"type": "string"}, "description": "Address of the evaluation."}}},
        **documented(
            "bad-request", "unauthorized", "forbidden", "payload-too-large", "validation-failed", "invalid-request",
            "unknown-scene", "unknown-method", "unsupported-scene", "too-many-requests",
        ),
    },
)  # fmt: skip
def submit(
    site: SiteOf,
    request: Request,
    response: Response,
    body: Annotated[EvaluationRequest, Body(openapi_examples=EXAMPLES)],
) -> EvaluationView:
    """Submit an evaluation. Its id is a hash of what is asked and of the code: the same request gets the same evaluation."""
    admit(body, site)
    status = site.queue.submit(body, body.priority)
    request.state.evaluation = status.id
    EVALUATION.set(status.id)
    response.headers["location"] = f"/v1/evaluations/{status.id}"
    return view(status)


@router.get(
    "",
    dependencies=[Read],
    responses=documented("unauthorized", "forbidden", "validation-failed", "invalid-cursor", "too-many-requests"),
)
def page(
    site: SiteOf,
    response: Response,
    state: Annotated[State | None, Query(description="Only evaluations in this state.")] = None,
    limit: Annotated[int, Query(ge=1, le=200, description="Most items of a page.")] = 50,
    cursor: Annotated[str | None, Query(max_length=500, description="`next_cursor` of the page before.")] = None,
) -> EvaluationPage:
    """Evaluations, newest first."""
    try:
        found, following = site.queue.list(state, limit, cursor)
    except ValueError as error:
        raise Problem("invalid-cursor", str(error)) from None
    if following is not None:
        tail = f"&state={state}" if state else ""
        response.headers["link"] = f'</v1/evaluations?limit={limit}&cursor={following}{tail}>; rel="next"'
    return EvaluationPage(items=[summary(status) for status in found], next_cursor=following)


@router.get(
    "/{id}",
    dependencies=[Read],
    responses=documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests"),
)
def read(site: SiteOf, response: Response, id: Id) -> EvaluationView:
    """State, progress and cells. While work is left, Retry-After says when to ask again."""
    status = site.evaluation(id)
    if status.state not in ENDED:
        response.headers["retry-after"] = POLL_S
    return view(status)


@router.delete(
    "/{id}",
    dependencies=[Submit],
    responses=documented("unauthorized", "forbidden", "not-found", "validation-failed", "too-many-requests"),
)
def cancel(site: SiteOf, id: Id) -> EvaluationView:
    """Cancel what is queued and what is running. An evaluation that has ended stays as it is."""
    status = site.evaluation(id)
    return view(status if status.state in ENDED else site.queue.cancel(id))


@router.post(
    "/{id}/retry",
    status_code=202,
    dependencies=[Submit],
    responses=documented("unauthorized", "forbidden", "not-found", "conflict", "validation-failed", "too-many-requests"),
)
def retry(site: SiteOf, id: Id) -> EvaluationSummary:
    """Do again what failed or was cancelled; what is done is kept."""
    status = site.evaluation(id)
    if status.state not in ("failed", "cancelled"):
        raise Problem("conflict", f"{id} is {status.state}; only failed and cancelled evaluations are retried")
    return summary(site.queue.retry(id))
