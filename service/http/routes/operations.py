"""For operators: health, readiness, metrics."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

from service.http.access import Read
from service.http.health import Readiness
from service.http.problems import documented
from service.http.site import SiteOf

router = APIRouter(tags=["operations"])


@router.get("/healthz")
def healthz() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.get("/readyz", responses={503: {"description": "Not ready, or not known yet", "model": Readiness}})
def readyz(site: SiteOf, response: Response) -> Readiness:
    """Store writable, queue reachable, OpenGL and Mitsuba working. The machine is checked in the background, seldom."""
    found = site.health.readiness()
    if not found.ready:
        response.status_code = 503
        response.headers["retry-after"] = "5"
    return found


@router.get(
    "/metrics",
    dependencies=[Read],
    response_model=None,
    responses={
        200: {"content": {"text/plain": {"schema": {"type": "string"}}}},
        **documented("unauthorized", "forbidden", "too-many-requests"),
    },
)
def metrics(request: Request) -> Response:
    """Prometheus text format."""
    return Response(generate_latest(request.app.state.metrics.registry), media_type=CONTENT_TYPE_LATEST)
