"""Values of command-line options."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs.errors import RequestError
from service import parse
from service.commands._evaluate import build


@given(st.integers(1, 8192), st.integers(1, 8192))
def test_sizes_read_back(width: int, height: int) -> None:
    assert parse.size(f"{width}x{height}") == (width, height)


@pytest.mark.parametrize("text", ["", "320", "320x", "x180", "0x180", "320x8193", "-1x2", "3.5x2", "320x180x3"])
def test_bad_sizes_are_refused(text: str) -> None:
    with pytest.raises(RequestError, match="--size takes WIDTHxHEIGHT"):
        parse.size(text)


@pytest.mark.parametrize(("text", "frames"), [("0:0", (0, 0)), ("3:7", (3, 7)), ("4", (4, 4))])
def test_frames(text: str, frames: tuple[int, int]) -> None:
    assert parse.frames(text) == frames


@pytest.mark.parametrize("text", ["", ":", "1:", ":1", "7:3", "-1:2", "a:b"])
def test_bad_frames_are_refused(text: str) -> None:
    with pytest.raises(RequestError, match="--frames takes A:B"):
        parse.frames(text)


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        (None, None),
        ("all", {"every": 1, "windows": []}),
        ("10", {"every": 10, "windows": []}),
        ("10,0:19,40:59", {"every": 10, "windows": [(0, 19), (40, 59)]}),
        ("5:6", {"every": None, "windows": [(5, 6)]}),
    ],
)
def test_frames_with_references(text: str | None, chosen: dict[str, object] | None) -> None:
    assert parse.references(text) == chosen


@pytest.mark.parametrize("text", ["", "0", "10,5", "every", "9:3", "10,", "all,0:3"])
def test_bad_frames_with_references_are_refused(text: str) -> None:
    with pytest.raises(RequestError, match="--references takes"):
        parse.references(text)


def test_assignments() -> None:
    found = parse.assignments(["a=1", "b=x=y", "c=[1, 2]", "d=none", "e="])
    assert found == {"a": "1", "b": "x=y", "c": [1, 2], "d": None, "e": ""}


@pytest.mark.parametrize("pairs", [["a"], ["=1"], ["a=1", "a=2"], ["a=[1"]])
def test_bad_assignments_are_refused(pairs: list[str]) -> None:
    with pytest.raises(RequestError):
        parse.assignments(pairs)


def test_evaluation_options_become_a_request() -> None:
    made = build(
        ["s"], ["m", "n"], ["m.k=1"], ["n.j=1,2", "m.l=[[1,2],[3,4]]"], size="8x4", seeds=2, frames="1:2",
        references="1:1", noise=0.1,
    )  # fmt: skip
    assert made.model_dump() == {
        "scenes": ["s"],
        "methods": [
            {"name": "m", "settings": {"k": "1"}, "sweep": {"l": [[1, 2], [3, 4]]}},
            {"name": "n", "settings": {}, "sweep": {"j": ["1", "2"]}},
        ],
        "size": (8, 4), "seeds": 2, "frames": (1, 2), "noise": 0.1, "priority": 5,
        "references": {"every": None, "windows": [(1, 1)]},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((["s"], ["m", "m"], [], []), "a method is given twice"),
        ((["s"], ["m"], ["k=1"], []), "--set takes METHOD.setting=value with one of m"),
        ((["s"], ["m"], ["x.k=1"], []), "--set takes METHOD.setting=value with one of m"),
        ((["s"], ["m"], ["m.k=1"], ["m.k=1,2"]), "k is both set and swept"),
        (([], ["m"], [], []), "scenes: "),
    ],
)
def test_contradictions_are_refused(options: tuple[list[str], list[str], list[str], list[str]], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        build(*options, size="8x4", seeds=1, frames="0:0", references=None, noise=0.1)
