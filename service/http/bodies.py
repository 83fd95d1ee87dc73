"""Request bodies: bounded in size, and refused when they trickle in."""

from __future__ import annotations

import asyncio
import time

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http import problems
from service.http.problems import Problem
from service.http.settings import ServerSettings

UPLOADS = "/v1/scenes"
ENVELOPE = 4096  # bytes that multipart/form-data may add around an uploaded file
CLOSE = {"connection": "close"}


class BodyLimits:
    """Middleware that watches the body while the application reads it."""

    def __init__(self, app: ASGIApp, settings: ServerSettings) -> None:
        self.app, self.settings = app, settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass anything but HTTP through. A body whose declared length is too large is refused unread."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        limit = self.settings.max_scene_bytes + ENVELOPE if scope["path"] == UPLOADS else self.settings.max_body_bytes
        declared = Headers(scope=scope).get("content-length", "0")
        if not declared.isdecimal() or int(declared[:18]) > limit:
            await problems.response("payload-too-large", _too_large(limit), CLOSE)(scope, receive, send)
            return
        await self.app(scope, _Watch(receive, limit, self.settings).receive, send)


class _Watch:
    """Counts and times one body. After it has ended, messages (a disconnect) are passed on without a deadline."""

    def __init__(self, receive: Receive, limit: int, settings: ServerSettings) -> None:
        self.upstream, self.limit, self.settings = receive, limit, settings
        self.start, self.bytes, self.ended = time.monotonic(), 0, False

    async def receive(self) -> Message:
        """The next message. Raises Problem when the body is too large or too slow."""
        if self.ended:
            return await self.upstream()
        allowed = self.settings.body_grace_s + self.bytes / self.settings.body_bytes_per_s
        left = self.start + allowed - time.monotonic()
        try:
            message = await asyncio.wait_for(self.upstream(), max(left, 0.001))
        except TimeoutError:
            pace = f"{self.settings.body_grace_s:g} s, then {self.settings.body_bytes_per_s} bytes a second"
            raise Problem("request-timeout", f"{self.bytes} bytes came; expected is all of it within {pace}", CLOSE) from None
        self.bytes += len(message.get("body", b""))
        self.ended = message["type"] != "http.request" or not message.get("more_body", False)
        if self.bytes > self.limit:
            raise Problem("payload-too-large", _too_large(self.limit), CLOSE)
        return message


def _too_large(limit: int) -> str:
    return f"at most {limit} bytes are taken here"
