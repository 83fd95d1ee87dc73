"""Values of command-line options: sizes, frame ranges, settings."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import ValidationError

from jobs.errors import RequestError, one_line
from jobs.request import EvaluationRequest

LARGEST = 8192


def size(text: str) -> tuple[int, int]:
    """`320x180` as (320, 180)."""
    width, x, height = text.lower().partition("x")
    if not (x and width.isdecimal() and height.isdecimal()) or not all(1 <= int(n) <= LARGEST for n in (width, height)):
        raise RequestError(f"--size takes WIDTHxHEIGHT with 1 to {LARGEST} pixels each (got {text!r})")
    return int(width), int(height)


def frames(text: str, option: str = "--frames") -> tuple[int, int]:
    """`A:B` as (A, B), both inclusive; `A` alone is one frame."""
    first, colon, last = text.partition(":")
    last = last if colon else first
    if not (first.isdecimal() and last.isdecimal()) or int(first) > int(last):
        raise RequestError(f"{option} takes A:B with 0 ≤ A ≤ B, both inclusive (got {text!r})")
    return int(first), int(last)


def references(text: str | None) -> dict[str, Any] | None:
    """`10,0:19,40:59` as every 10th frame and two windows, `all` as every frame; None, the request's default, stays None."""
    if text is None:
        return None
    parts = ["1"] if text == "all" else text.split(",")
    every = [part for part in parts if ":" not in part]
    if len(every) > 1 or not all(part.isdecimal() and int(part) > 0 for part in every):
        raise RequestError(f"--references takes K,A:B,… (every K-th frame, windows of frames) or all (got {text!r})")
    return {
        "every": int(every[0]) if every else None,
        "windows": [frames(part, "--references") for part in parts if ":" in part],
    }


def assignments(pairs: Iterable[str], option: str = "--set") -> dict[str, Any]:
    """`key=value` pairs; values that are JSON lists or objects are read as such, `none` as nothing, all else stays text."""
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key:
            raise RequestError(f"{option} takes name=value (got {pair!r})")
        if key in found:
            raise RequestError(f"{option} {key} is given twice")
        found[key] = value(text)
    return found


def value(text: str) -> Any:
    """One value; the settings model turns text into numbers and booleans."""
    if text[:1] in "[{" and text:
        try:
            return json.loads(text)
        except json.JSONDecodeError as error:
            raise RequestError(f"not JSON: {text!r} ({error.msg})") from None
    return None if text in ("none", "null") else text


def request(values: dict[str, Any]) -> EvaluationRequest:
    """An evaluation request. Raises RequestError with the first problem in one line."""
    try:
        return EvaluationRequest.model_validate(values)
    except ValidationError as error:
        raise RequestError(one_line(error)) from None


def choice(option: str, text: str, allowed: Sequence[str]) -> None:
    """Raises RequestError unless `text` is one of `allowed`."""
    if text not in allowed:
        raise RequestError(f"{option} takes one of {', '.join(allowed)} (got {text!r})")


def share(option: str, number: float) -> None:
    """Raises RequestError unless 0 < number ≤ 1."""
    if not 0 < number <= 1:
        raise RequestError(f"{option} takes a number above 0, at most 1 (got {number:g})")
