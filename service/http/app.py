"""The FastAPI application: one queue behind, JSON under /v1, pages for people beside it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response

import reports
from jobs.code import installed
from jobs.doctor import Check, check_all
from jobs.errors import RequestError, StoreError
from renderers import SceneError, UnknownMethod, UnsupportedScene
from service.http import pages, problems
from service.http.bodies import BodyLimits
from service.http.comparisons import Comparisons
from service.http.headers import Origins, SecurityHeaders
from service.http.health import Health
from service.http.logs import RequestLog
from service.http.metrics import Metrics
from service.http.models import EventPage, ResultList
from service.http.pages import STATIC
from service.http.queue import Queue
from service.http.rates import RateLimit
from service.http.routes import comparisons, evaluations, events, methods, operations, results, scenes
from service.http.routes import reports as report_routes
from service.http.settings import ServerSettings
from service.http.site import Site
from service.http.sources import RETRY_S, Sources
from service.http.streams import Streams
from service.http.thumbnails import Thumbnails
from service.http.uploads import Uploads
from service.tokens import TokenStore

DESCRIPTION = """Measure real-time global illumination and soft shadows against path-traced truth.

Errors are RFC 9457 problem documents; the `type` of each is the address of a page that says what to do."""
REFUSALS: dict[type[Exception], str] = {
    RequestError: "invalid-request",
    SceneError: "unknown-scene",
    UnknownMethod: "unknown-method",
    UnsupportedScene: "unsupported-scene",
}
log = logging.getLogger(__name__)
SCHEMES = {"bearer": {"type": "http", "scheme": "bearer", "description": "Needed once the operator has made a token."}}


def create_app(queue: Queue, settings: ServerSettings | None = None, machine: Callable[[], Sequence[Check]] = check_all) -> FastAPI:
    """The application over a queue. `machine` answers readiness checks of this computer."""
    settings = settings or ServerSettings()
    served = Metrics(queue)
    app = FastAPI(
        title="luxmeter",
        version=installed("luxmeter"),
        description=DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        middleware=[
            Middleware(SecurityHeaders),
            Middleware(RequestLog, metrics=served),
            Middleware(Origins, hosts=settings.hosts),
            Middleware(RateLimit, settings=settings),
            Middleware(BodyLimits, settings=settings),
        ],
        redirect_slashes=False,
    )
    app.state.metrics = served
    app.state.site = Site(
        queue, settings, TokenStore(settings.home / "tokens.json"), Uploads(settings), Thumbnails(settings),
        Sources(settings.home, queue), Comparisons(settings, queue), Health(queue, settings, machine),
        Streams(settings.max_streams),
    )  # fmt: skip
    for module in (evaluations, events, results, report_routes, methods, scenes, comparisons, operations, pages):
        app.include_router(module.router)
    app.mount("/static/report", StaticFiles(directory=Path(reports.__file__).parent / "assets"))
    app.mount("/static", StaticFiles(directory=STATIC))
    app.add_api_route("/openapi.json", app.openapi, include_in_schema=False, response_model=None)
    _handle_errors(app)
    app.openapi = lambda: _schema(app)  # type: ignore[method-assign]
    return app


def _handle_errors(app: FastAPI) -> None:
    app.add_exception_handler(HTTPException, pages.or_problem)
    app.add_exception_handler(RequestValidationError, problems.of_validation)
    app.add_exception_handler(StoreError, _store_unavailable)
    for kind, name in REFUSALS.items():
        app.add_exception_handler(kind, _refusal(name))


def _store_unavailable(request: Request, error: Exception) -> Response:
    """Database or store is full, locked or away. The log says which and where; clients needn't know."""
    log.error("%s", error)
    detail = "the queue's database or the artefact store can't be used now"
    return problems.response("unavailable", detail, {"retry-after": RETRY_S})


def _refusal(name: str) -> Callable[[Request, Exception], Response]:
    return lambda request, error: problems.response(name, " ".join(str(error).split()))


def _schema(app: FastAPI) -> dict[str, Any]:
    """OpenAPI 3.1, with the problem document as the one schema of errors."""
    if app.openapi_schema is None:
        found = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        schemas = found["components"]["schemas"]
        schemas["Problem"] = problems.PROBLEM_SCHEMA
        for model in (EventPage, ResultList):
            whole = model.model_json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
            schemas |= whole.pop("$defs", {}) | {model.__name__: whole}
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        found["components"]["securitySchemes"] = SCHEMES
        found["security"] = [{}, {"bearer": []}]
        app.openapi_schema = found
    return app.openapi_schema
