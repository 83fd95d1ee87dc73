"""What the routes share: the queue, the settings, the stores beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, cast

from fastapi import Depends, Request

from service.http.comparisons import Comparisons
from service.http.health import Health
from service.http.problems import Problem
from service.http.queue import Queue, Status
from service.http.settings import ServerSettings
from service.http.sources import Sources
from service.http.streams import Streams
from service.http.thumbnails import Thumbnails
from service.http.uploads import Uploads
from service.tokens import TokenStore


@dataclass(frozen=True)
class Site:
    """One running service."""

    queue: Queue
    settings: ServerSettings
    tokens: TokenStore
    uploads: Uploads
    thumbnails: Thumbnails
    sources: Sources
    comparisons: Comparisons
    health: Health
    streams: Streams

    def evaluation(self, id: str) -> Status:
        """The evaluation of that id. Raises Problem where there is none."""
        try:
            return self.queue.status(id)
        except KeyError:
            raise Problem("not-found", f"no evaluation {id}") from None


def of(request: Request) -> Site:
    """The service that this request came to."""
    return cast(Site, request.app.state.site)


SiteOf = Annotated[Site, Depends(of)]
