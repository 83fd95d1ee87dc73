"""Files of one evaluation: its report, and artefacts by their content hash."""

from __future__ import annotations

import hashlib
import io
import re
from typing import Annotated

from fastapi import APIRouter, Request
from fastapi import Path as InPath
from starlette.responses import Response

from service.http.access import Read
from service.http.files import DEFAULT_TYPE, media_type, serve
from service.http.problems import Problem, documented
from service.http.queue import ENDED
from service.http.routes.evaluations import POLL_S, Id
from service.http.routes.results import BINARY
from service.http.site import Site, SiteOf

router = APIRouter(prefix="/v1/evaluations", tags=["results"])
PART = r"[A-Za-z0-9_-][A-Za-z0-9._ =,+-]*"
PATH = re.compile(rf"{PART}(?:/{PART})*")
Hash = Annotated[str, InPath(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the content.")]
HTML = {"text/html": {"schema": {"type": "string"}}}
PROBLEMS = (
    "unauthorized",
    "forbidden",
    "not-found",
    "not-ready",
    "range-not-satisfiable",
    "validation-failed",
    "too-many-requests",
)


@router.get("/{id}/report", dependencies=[Read], response_model=None, responses={200: {"content": HTML}, **documented(*PROBLEMS)})
def report(site: SiteOf, request: Request, id: Id) -> Response:
    """The report's first page. Its links lead below `…/report/`, where the same page stands as well."""
    page = _file(site, id, "index.html").decode()
    based = page.replace("<head>", f'<head>\n<base href="/v1/evaluations/{id}/report/">', 1)
    return _serve(request, based.encode(), "index.html")


@router.head("/{id}/report", dependencies=[Read], response_model=None, include_in_schema=False)
def report_head(site: SiteOf, request: Request, id: Id) -> Response:
    """See `report`."""
    return report(site, request, id)


@router.api_route(
    "/{id}/report/{path:path}", methods=["GET", "HEAD"], dependencies=[Read], response_model=None, include_in_schema=False
)
def report_file(site: SiteOf, request: Request, id: Id, path: str) -> Response:
    """A file of the report; the page itself for an empty path."""
    path = path or "index.html"
    return _serve(request, _file(site, id, path), path)


@router.get(
    "/{id}/artifacts/{hash}",
    dependencies=[Read],
    response_model=None,
    responses={
        200: {"content": {DEFAULT_TYPE: BINARY}},
        206: {"description": "The range that was asked for", "content": {DEFAULT_TYPE: BINARY}},
        304: {"description": "The client has it already"},
        **documented(*(name for name in PROBLEMS if name != "not-ready")),
    },
)
def artifact(site: SiteOf, request: Request, id: Id, hash: Hash) -> Response:
    """Content by its hash. It never changes: the hash is its entity tag, ranges resume a download."""
    site.evaluation(id)
    found = site.queue.artifact(hash)
    if found is None:
        raise Problem("not-found", f"no artefact {hash}")
    return serve(request, *found, f'"{hash}"', DEFAULT_TYPE, "private, max-age=31536000, immutable")


@router.head("/{id}/artifacts/{hash}", dependencies=[Read], response_model=None, include_in_schema=False)
def artifact_head(site: SiteOf, request: Request, id: Id, hash: Hash) -> Response:
    """See `artifact`."""
    return artifact(site, request, id, hash)


def _file(site: Site, id: str, path: str) -> bytes:
    """A file of the report. Raises Problem where there is none, or none yet."""
    status = site.evaluation(id)
    content = site.queue.report_file(id, path) if PATH.fullmatch(path) else None
    if content is not None:
        return content
    if status.state not in ENDED or status.finished is None:  # a cancelled one still gets the report of what was done
        raise Problem("not-ready", f"{id} is {status.state}", {"retry-after": POLL_S})
    if path == "index.html":
        raise Problem("conflict", f"{id} was {status.state} before it had a report")
    raise Problem("not-found", f"the report of {id} has no file {path[:200]!r}")


def _serve(request: Request, content: bytes, path: str) -> Response:
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    return serve(request, io.BytesIO(content), len(content), tag, media_type(path), "private, no-cache")
