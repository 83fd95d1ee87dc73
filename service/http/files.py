"""Answers that are files: entity tags, conditions, one byte range (RFC 9110, 13 and 14)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import BinaryIO

from fastapi import Request
from starlette.responses import Response, StreamingResponse

from service.http.problems import Problem

CHUNK = 256 * 1024
TYPES = {
    "html": "text/html; charset=utf-8", "css": "text/css; charset=utf-8", "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml", "png": "image/png", "webp": "image/webp", "json": "application/json", "csv": "text/csv; charset=utf-8",
    "txt": "text/plain; charset=utf-8", "parquet": "application/vnd.apache.parquet", "exr": "image/x-exr",
}  # fmt: skip
DEFAULT_TYPE = "application/octet-stream"


def media_type(path: str) -> str:
    """Media type by the suffix of a file name."""
    return TYPES.get(path.rpartition(".")[2].lower(), DEFAULT_TYPE)


def unchanged(request: Request, tag: str) -> bool:
    """Whether the client has this content already (If-None-Match)."""
    wanted = request.headers.get("if-none-match")
    return wanted is not None and (wanted.strip() == "*" or tag in [t.strip().removeprefix("W/") for t in wanted.split(",")])


def serve(request: Request, file: BinaryIO, size: int, tag: str, kind: str, cache: str) -> Response:
    """The file, the part of it that was asked for, or 304. Closes the file. Raises Problem for a range outside of it."""
    headers = {"etag": tag, "accept-ranges": "bytes", "cache-control": cache}
    if unchanged(request, tag):
        file.close()
        return Response(status_code=304, headers=headers)
    try:
        span = None if request.headers.get("if-range", tag) != tag else parse_range(request.headers.get("range"), size)
    except Problem:
        file.close()
        raise
    first, last = span or (0, size - 1)
    headers["content-length"] = str(last - first + 1)
    if span is not None:
        headers["content-range"] = f"bytes {first}-{last}/{size}"
    status = 200 if span is None else 206
    if request.method == "HEAD":
        file.close()
        return Response(status_code=status, headers=headers, media_type=kind)
    return StreamingResponse(_read(file, first, last - first + 1), status, headers, kind)


def parse_range(header: str | None, size: int) -> tuple[int, int] | None:
    """First and last byte of `bytes=a-b`, `bytes=a-` or `bytes=-n`; None for anything else (of several ranges, too)."""
    found = re.fullmatch(r"bytes=(\d{0,18})-(\d{0,18})", (header or "").strip())
    if found is None or found[0] == "bytes=-":
        return None
    start, end = found[1], found[2]
    if start and end and int(start) > int(end):
        return None
    first = int(start) if start else max(size - int(end), 0)
    last = min(int(end), size - 1) if start and end else size - 1
    if first >= size or (not start and int(end) == 0):
        raise Problem("range-not-satisfiable", f"the content has {size} bytes", {"content-range": f"bytes */{size}"})
    return first, last


def _read(file: BinaryIO, first: int, length: int) -> Iterator[bytes]:
    with file:
        file.seek(first)
        while length > 0:
            chunk = file.read(min(CHUNK, length))
            if not chunk:
                return
            length -= len(chunk)
            yield chunk
