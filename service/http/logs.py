"""Structured logs: one JSON object a line, with the ids of the request and of the evaluation that the line belongs to."""

from __future__ import annotations

import json
import logging
import re
import secrets
import sys
import time
from contextvars import ContextVar
from datetime import UTC, datetime

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http import problems
from service.http.metrics import Metrics

EVALUATION: ContextVar[str | None] = ContextVar("evaluation", default=None)
REQUEST: ContextVar[str | None] = ContextVar("request", default=None)
IN_PATH = re.compile(r"^/(?:v1/)?evaluations/([A-Za-z0-9._-]{1,64})(?:/|$)")
log = logging.getLogger("luxmeter.http")


class JsonFormatter(logging.Formatter):
    """Time, level, logger, message; `evaluation` and `request` where known; `fields` and `evaluation` given as `extra`."""

    def format(self, record: logging.LogRecord) -> str:
        """One line of ASCII JSON."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            "evaluation": getattr(record, "evaluation", None) or EVALUATION.get(),
            "request": REQUEST.get(),
        } | getattr(record, "fields", {})
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps({key: value for key, value in line.items() if value is not None}, default=str)


def configure(level: int = logging.INFO) -> None:
    """Send every log line of this process to standard error as JSON."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter())
    logging.basicConfig(level=level, handlers=[handler], force=True)


class RequestLog:
    """Middleware around all that can fail: names the request, logs its outcome, and answers unexpected exceptions as problems."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app, self.metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass anything but HTTP through."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request, start, status = secrets.token_hex(8), time.monotonic(), 0
        named = IN_PATH.match(scope["path"])
        REQUEST.set(request)
        EVALUATION.set(named[1] if named else None)

        async def sender(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message["headers"], (b"x-request-id", request.encode())]
            await send(message)

        try:
            await self.app(scope, receive, sender)
        except Exception:
            log.exception("request failed")
            if status:
                raise  # too late for another answer; the server cuts the connection
            answer = problems.response("internal-error", f"request {request}")
            await answer(scope, receive, sender)
        finally:
            EVALUATION.set(scope.get("state", {}).get("evaluation") or EVALUATION.get())
            seconds = time.monotonic() - start
            self.metrics.answered(scope["method"], getattr(scope.get("route"), "path", "none"), status, seconds)
            client = (scope.get("client") or ("",))[0]
            fields = {
                "method": scope["method"],
                "path": scope["path"],
                "status": status,
                "seconds": round(seconds, 4),
                "client": client,
            }
            log.info("%s %s %s", scope["method"], scope["path"], status, extra={"fields": fields})
