"""Rate limits: one token bucket per client address, a smaller one for requests that change something."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable

from starlette.types import ASGIApp, Receive, Scope, Send

from service.http import problems
from service.http.headers import SAFE
from service.http.settings import ServerSettings

MOST_CLIENTS = 10_000


class Buckets:
    """Buckets of `burst` that refill by `rate` a second. At most MOST_CLIENTS are remembered, the longest unseen goes first."""

    def __init__(self, rate: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.rate, self.burst, self.clock = rate, burst, clock
        self._levels: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, client: str) -> float:
        """Take one from the client's bucket; returns 0, or the seconds until there is one."""
        if self.rate <= 0:
            return 0.0
        now = self.clock()
        level, at = self._levels.pop(client, (self.burst, now))
        level = min(self.burst, level + (now - at) * self.rate)
        taken = level >= 1
        self._levels[client] = (level - 1 if taken else level, now)
        if len(self._levels) > MOST_CLIENTS:
            self._levels.popitem(last=False)
        return 0.0 if taken else (1 - level) / self.rate


class RateLimit:
    """Middleware that answers 429 with Retry-After once a client's bucket is empty. Health checks are never limited."""

    def __init__(self, app: ASGIApp, settings: ServerSettings) -> None:
        self.app = app
        self.requests = Buckets(settings.requests_per_s, settings.request_burst)
        self.changes = Buckets(settings.submissions_per_s, settings.submission_burst)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass anything but HTTP through."""
        if scope["type"] == "http" and scope["path"] not in ("/healthz", "/readyz"):
            client = (scope.get("client") or ("",))[0]
            wait = self.requests.take(client)
            if not wait and scope["method"] not in SAFE:
                wait = self.changes.take(client)
            if wait:
                seconds = str(math.ceil(wait))
                await problems.response("too-many-requests", f"ask again in {seconds} s", {"retry-after": seconds})(
                    scope, receive, send
                )
                return
        await self.app(scope, receive, send)
