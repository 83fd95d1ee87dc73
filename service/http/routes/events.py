"""Progress of one evaluation: server-sent events, or a list to poll."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, Header, Query
from starlette.responses import JSONResponse, Response, StreamingResponse

from service.http.access import Read
from service.http.models import EventPage
from service.http.negotiation import choose
from service.http.problems import documented
from service.http.queue import ENDED
from service.http.routes.evaluations import POLL_S, Id
from service.http.site import Site, SiteOf

router = APIRouter(prefix="/v1/evaluations", tags=["evaluations"])
STREAM, LIST = "text/event-stream", "application/json"
KEEP_ALIVE_S = 15.0
LARGEST = 2**53 - 1
EVENT = {  # before OpenAPI 3.2, the schema of a stream of events describes each event
    "type": "object",
    "required": ["data"],
    "properties": {
        "id": {"type": "string", "pattern": "^[0-9]+$", "description": "The event's `seq`; none on the last one."},
        "event": {"enum": ["message", "end"]},
        "data": {"type": "string", "contentMediaType": "application/json", "contentSchema": {"type": "object"}},
    },
}
Sequence = Annotated[int | None, Query(ge=0, le=LARGEST, description="Only events with a greater `seq`.")]
LastEvent = Annotated[int | None, Header(alias="Last-Event-ID", ge=0, le=LARGEST, description="Sent by a client that reconnects.")]


@router.get(
    "/{id}/events",
    dependencies=[Read],
    response_model=None,
    responses={
        200: {
            "description": "Events as they happen, each with `id: SEQ`; the last one is called `end`. As JSON: the events so far.",
            "content": {STREAM: {"schema": EVENT}, LIST: {"schema": {"$ref": "#/components/schemas/EventPage"}}},
        },
        **documented(
            "unauthorized", "forbidden", "not-found", "not-acceptable", "validation-failed", "too-many-requests", "unavailable"
        ),
    },
)
async def events(
    site: SiteOf, id: Id, after: Sequence = None, last_event: LastEvent = None, accept: Annotated[str | None, Header()] = None
) -> Response:
    """Follow an evaluation. A stream that broke off is resumed by Last-Event-ID or `after`; nothing is lost or told twice."""
    kind = choose(accept, (STREAM, LIST))
    start = last_event if last_event is not None else after or 0
    status = await run_sync(site.evaluation, id)
    if kind == LIST:
        found = await run_sync(site.queue.events, id, start)
        page = EventPage(events=[dict(event) for event in found], state=status.state)
        return JSONResponse(page.model_dump(mode="json"), headers={} if status.state in ENDED else {"retry-after": POLL_S})
    site.streams.check()
    return StreamingResponse(
        stream(site, id, start), media_type=STREAM, headers={"cache-control": "no-store", "x-accel-buffering": "no"}
    )


async def stream(site: Site, id: str, after: int) -> AsyncIterator[str]:
    """Events in the wire format. The state is read before the events, so that none can follow an ended one unseen."""
    with site.streams.one():
        yield "retry: 2000\n\n"
        told = time.monotonic()
        while True:
            state = (await run_sync(site.queue.status, id)).state
            found = await run_sync(site.queue.events, id, after)
            for event in found:
                after = int(event["seq"])
                yield f"id: {after}\ndata: {json.dumps(dict(event), default=str)}\n\n"
            if state in ENDED:
                yield f"event: end\ndata: {json.dumps({'state': state})}\n\n"
                return
            if found or time.monotonic() - told > KEEP_ALIVE_S:
                told = time.monotonic()
                yield "" if found else ": still here\n\n"
            await asyncio.sleep(site.settings.poll_s)
