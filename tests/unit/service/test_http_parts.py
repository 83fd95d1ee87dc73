"""Parts of the HTTP interface by themselves: buckets, ranges, negotiation, the cells' table, what a report links to."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.folder import Cell
from service.client import linked_files
from service.commands._serve import is_loopback
from service.errors import ServiceError
from service.http.files import parse_range
from service.http.matrix import matrix
from service.http.negotiation import choose
from service.http.problems import Problem
from service.http.rates import MOST_CLIENTS, Buckets

OFFERED = ("application/json", "text/csv")


@given(st.floats(0.1, 50), st.integers(1, 40), st.lists(st.floats(0, 3), max_size=60))
def test_a_bucket_never_gives_more_than_burst_plus_rate_times_time(rate: float, burst: int, pauses: list[float]) -> None:
    now = 0.0
    buckets = Buckets(rate, burst, clock=lambda: now)
    given_out = 0
    for pause in pauses:
        now += pause
        wait = buckets.take("a")
        given_out += wait == 0
        assert wait >= 0
        if wait:  # a refused client that waits as long as it was told gets one
            now += wait + 1e-6
            assert buckets.take("a") == 0
            given_out += 1
    assert given_out <= burst + rate * now + 1e-6


def test_buckets_forget_the_longest_unseen() -> None:
    buckets = Buckets(1, 1, clock=lambda: 0.0)
    assert buckets.take("first") == 0
    assert buckets.take("first") > 0
    for n in range(MOST_CLIENTS):
        buckets.take(str(n))
    assert len(buckets._levels) == MOST_CLIENTS
    assert buckets.take("first") == 0


@given(st.integers(1, 200), st.integers(0, 250), st.integers(0, 250))
def test_ranges_give_what_slices_give(size: int, a: int, b: int) -> None:
    content = bytes(k % 251 for k in range(size))
    expected: dict[str, bytes | None] = {f"bytes={a}-": content[a:], f"bytes=-{a}": content[max(size - a, 0) :]}
    expected[f"bytes={a}-{b}"] = content[a : b + 1] if a <= b else None
    for header, part in expected.items():
        if part == b"":
            with pytest.raises(Problem, match=f"the content has {size} bytes"):
                parse_range(header, size)
        else:
            found = parse_range(header, size)
            assert (None if found is None else content[found[0] : found[1] + 1]) == part


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, "application/json"),
        ("*/*", "application/json"),
        ("text/csv", "text/csv"),
        ("text/*, application/json;q=0.5", "text/csv"),
        ("application/json;q=0.2, text/csv;q=0.9", "text/csv"),
        ("text/csv;q=0, */*", "application/json"),
        ("TEXT/CSV", "text/csv"),
        ("application/json;q=odd", "application/json"),
    ],
)
def test_negotiation(accept: str | None, chosen: str) -> None:
    assert choose(accept, OFFERED) == chosen


@pytest.mark.parametrize("accept", ["image/png", "text/csv;q=0", ";;", "application/json;q=0, text/csv;q=0"])
def test_nothing_wanted_is_a_problem(accept: str) -> None:
    with pytest.raises(Problem, match="offered: application/json, text/csv"):
        choose(accept, OFFERED)


def cell(scene: str, label: str, seed: int, state: str) -> Cell:
    return Cell.model_validate(
        {
            "id": f"{scene}.{label}.s{seed}", "scene": scene, "method": "ir", "label": label, "settings": {}, "seed": seed,
            "frame": 0, "width": 8, "height": 6, "transport": "direct", "state": state,
        }
    )  # fmt: skip


def test_the_matrix_counts_cells() -> None:
    cells = [cell("a", "x", 0, "done"), cell("a", "x", 1, "queued"), cell("a", "y", 0, "failed"), cell("b", "x", 0, "done")]
    found = matrix(cells)
    assert found.labels == ["x", "y"]
    squares = {(scene, label): s for scene, row in found.rows for label, s in zip(found.labels, row, strict=True)}
    assert (squares["a", "x"].state, squares["a", "x"].text) == ("running", "1 of 2")
    assert squares["a", "y"].state == "failed"
    assert squares["b", "x"].text == "done"
    assert squares["b", "y"] is None


def test_files_of_a_report() -> None:
    page = (
        '<link href="assets/report.css"><a href="#top"><a href="images/a%20b.exr"><img src="data:,">'
        '<script type="application/json">{"frames": [{"images": [{"id": "s0-r0"}]}]}</script>'
        '<script src="assets/viewer.js"></script>'
    )
    assert linked_files(page) == [
        "assets/report.css", "images/a b.exr", "assets/data/s0-r0.js", "assets/thumbnails/s0-r0.png",
        "assets/viewer.js",
    ]  # fmt: skip
    for bad in ("../../x", "https://evil.example/x", "a/../../x", "..%2fx"):
        with pytest.raises(ServiceError, match="outside"):
            linked_files(f'<a href="{bad}">')


OWN, OTHERS = ("127.0.0.1", "127.8.8.8", "::1", "localhost"), ("0.0.0.0", "::", "10.0.0.1", "example.org")


@pytest.mark.parametrize("host", [*OWN, *OTHERS])
def test_loopback_addresses(host: str) -> None:
    assert is_loopback(host) is (host in OWN)
