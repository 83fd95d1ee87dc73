"""Which of the offered media types a client wants (RFC 9110, 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence

from service.http.problems import Problem


def choose(accept: str | None, offered: Sequence[str]) -> str:
    """The offered type of the highest quality, the first of equal ones. Raises Problem where none is wanted."""
    if accept is None or not accept.strip():
        return offered[0]
    ranges = [_parse(part) for part in accept.split(",")]
    qualities = [_quality(kind, ranges) for kind in offered]
    best = max(qualities)
    if best <= 0:
        raise Problem("not-acceptable", f"offered: {', '.join(offered)}")
    return offered[qualities.index(best)]


def _parse(part: str) -> tuple[str, float]:
    """A media range and its quality; a quality that is no number counts as 1."""
    kind, *parameters = (piece.strip() for piece in part.split(";"))
    quality = 1.0
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip().lower() == "q":
            try:
                quality = float(value)
            except ValueError:
                quality = 1.0
    return kind.lower(), quality


def _quality(kind: str, ranges: Sequence[tuple[str, float]]) -> float:
    """Quality of a type: that of the most specific range that covers it."""
    for pattern in (kind, f"{kind.partition('/')[0]}/*", "*/*"):
        found = [quality for named, quality in ranges if named == pattern]
        if found:
            return found[0]
    return 0.0
