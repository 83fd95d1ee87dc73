"""Errors as RFC 9457 problem documents. Every kind has a page at its `type`, `/problems/NAME`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

MEDIA_TYPE = "application/problem+json"


@dataclass(frozen=True)
class Kind:
    """One kind of problem: its status, its title, and what a client can do about it."""

    status: int
    title: str
    advice: str


KINDS: dict[str, Kind] = {
    "bad-request": Kind(400, "The request can't be read", "Check the syntax of the request and of its body."),
    "unauthorized": Kind(
        401,
        "A token is needed",
        "Send `Authorization: Bearer TOKEN`; `luxmeter token add` makes one. In a browser, log in at /login.",
    ),
    "forbidden": Kind(403, "The token does not allow this", "Use a token with the scope that `detail` names."),
    "foreign-origin": Kind(403, "The request comes from another site", "Only the service's own pages may send it from a browser."),
    "not-found": Kind(404, "There is nothing at this address", "Check the id or name; the lists under /v1 show what there is."),
    "method-not-allowed": Kind(405, "This address does not take this HTTP method", "The Allow header lists the ones it takes."),
    "not-acceptable": Kind(406, "None of the wanted media types is offered", "Accept one of the types that `detail` lists."),
    "request-timeout": Kind(408, "The body came too slowly", "Send it again over a better connection."),
    "not-ready": Kind(409, "It is not there yet", "Ask again after the seconds in Retry-After, or follow the events."),
    "conflict": Kind(409, "The state does not allow this", "Read the evaluation's state first."),
    "payload-too-large": Kind(413, "The body is too large", "Stay under the limit that `detail` names."),
    "misdirected": Kind(421, "The service is not called that", "Address it by a name that its operator allows."),
    "unsupported-media-type": Kind(415, "The body has the wrong media type", "Send one of the types that `detail` names."),
    "range-not-satisfiable": Kind(416, "The range lies outside the content", "Content-Range says how long the content is."),
    "validation-failed": Kind(422, "The request does not match its schema", "`errors` points at each field that doesn't."),
    "invalid-request": Kind(422, "The evaluation can't be planned", "`detail` names the field and what it takes."),
    "invalid-cursor": Kind(422, "The cursor is not one of ours", "Use `next_cursor` of the page before, unchanged."),
    "unknown-scene": Kind(422, "There is no such scene", "GET /v1/scenes lists them; POST /v1/scenes adds one."),
    "unknown-method": Kind(422, "There is no such method", "GET /v1/methods lists them."),
    "unsupported-scene": Kind(422, "No asked method can render the scene", "GET /v1/methods/NAME shows what each refuses."),
    "refused-scene": Kind(422, "The scene file is refused", "`detail` names the element and the reason."),
    "too-many-requests": Kind(429, "Too many requests", "Ask again after the seconds in Retry-After."),
    "internal-error": Kind(500, "Something went wrong here", "The log of the service holds the request id that `detail` names."),
    "unavailable": Kind(503, "The service can't do this now", "Ask again after the seconds in Retry-After."),
}
BY_STATUS = {400: "bad-request", 404: "not-found", 405: "method-not-allowed"}  # what the framework raises by itself


class Problem(HTTPException):
    """Raise it anywhere under a request: it becomes the answer. `more` are further members of the document."""

    def __init__(self, name: str, detail: str, headers: Mapping[str, str] | None = None, **more: Any) -> None:
        super().__init__(KINDS[name].status, detail, dict(headers or {}))
        self.name, self.more = name, more


def response(name: str, detail: str, headers: Mapping[str, str] | None = None, **more: Any) -> Response:
    """The answer that tells a problem. ASCII only, so that text of any origin can stand in it."""
    kind = KINDS[name]
    document = {"type": f"/problems/{name}", "title": kind.title, "status": kind.status, "detail": detail} | more
    return Response(json.dumps(document), kind.status, dict(headers or {}), MEDIA_TYPE)


def of_http_exception(request: Request, error: Exception) -> Response:
    """Problems raised by us, and what the framework itself refuses (404, 405, unreadable bodies)."""
    assert isinstance(error, HTTPException)
    if isinstance(error, Problem):
        return response(error.name, error.detail, error.headers, **error.more)
    name = BY_STATUS.get(error.status_code, "bad-request" if error.status_code < 500 else "internal-error")
    detail = f"{request.method} {request.url.path}: {HTTPStatus(KINDS[name].status).phrase}"
    if error.detail and error.detail != HTTPStatus(error.status_code).phrase:
        detail = str(error.detail)
    return response(name, detail, error.headers)


def of_validation(request: Request, error: Exception) -> Response:
    """What does not match the schema, each with a JSON pointer into the body or the name of the parameter."""
    assert isinstance(error, RequestValidationError)
    found = error.errors()
    if found[0]["type"] == "json_invalid":
        return response("bad-request", f"the body is not JSON: {found[0].get('ctx', {}).get('error', found[0]['msg'])}")
    errors = [{"pointer": _pointer(e["loc"]), "detail": str(e["msg"])} for e in found[:20]]
    first = f"{errors[0]['pointer']}: {errors[0]['detail']}"
    return response("validation-failed", first if len(found) == 1 else f"{first}; {len(found) - 1} more", errors=errors)


def _pointer(location: tuple[int | str, ...]) -> str:
    where, *path = location
    if where != "body":
        return f"{where} parameter {'.'.join(str(p) for p in path)}"
    return "#/" + "/".join(str(p).replace("~", "~0").replace("/", "~1") for p in path)


def documented(*names: str) -> dict[int | str, dict[str, Any]]:
    """Entries of an operation's `responses` for these problems, several of one status told in one entry."""
    entries: dict[int | str, dict[str, Any]] = {}
    for name in names:
        kind = KINDS[name]
        example = {"type": f"/problems/{name}", "title": kind.title, "status": kind.status, "detail": kind.advice}
        entry = entries.setdefault(
            kind.status, {"description": "", "content": {MEDIA_TYPE: {"schema": PROBLEM_REFERENCE, "examples": {}}}}
        )
        entry["description"] = f"{entry['description']}; {kind.title}".removeprefix("; ")
        entry["content"][MEDIA_TYPE]["examples"][name] = {"value": example}
    return entries


PROBLEM_REFERENCE = {"$ref": "#/components/schemas/Problem"}
PROBLEM_SCHEMA: dict[str, Any] = {
    "type": "object",
    "title": "Problem",
    "description": "RFC 9457 problem document.",
    "required": ["type", "title", "status", "detail"],
    "properties": {
        "type": {"type": "string", "format": "uri-reference", "description": "Address of a page on this kind of problem."},
        "title": {"type": "string"},
        "status": {"type": "integer", "minimum": 400, "maximum": 599},
        "detail": {"type": "string", "description": "What is wrong with this request."},
        "errors": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["pointer", "detail"],
                "properties": {"pointer": {"type": "string"}, "detail": {"type": "string"}},
            },
        },
    },
}
