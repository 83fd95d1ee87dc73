"""The rule that turns published and measured figures into one word."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs.claims import Answer, Measurement, Row, registered_claims, row
from jobs.claims.model import Direction, Status

# 95 % interval of these: 10 ± 4.303
AROUND_TEN = [8.0, 10.0, 12.0]


def ten(published: float | None, direction: Direction, within: float = 0.0, comparable: bool = True) -> Row:
    return row("case.figure", "figure", "1", published, AROUND_TEN, direction, within=within, comparable=comparable)


@pytest.mark.parametrize(
    ("published", "direction", "within", "verdict"),
    [
        (5.0, "higher", 0.0, "better"),
        (5.0, "higher", 0.2, "reproduced"),
        (12.0, "higher", 0.0, "reproduced"),
        (15.0, "higher", 0.0, "deviates"),
        (15.0, "higher", 0.05, "reproduced"),
        (15.0, "lower", 0.0, "better"),
        (8.0, "lower", 0.0, "reproduced"),
        (5.0, "lower", 0.0, "deviates"),
        (5.0, "lower", 0.2, "reproduced"),
        (9.0, "equal", 0.0, "reproduced"),
        (15.0, "equal", 0.0, "deviates"),
        (5.0, "equal", 0.0, "deviates"),
        (15.0, "equal", 0.05, "reproduced"),
        (None, "equal", 0.0, "not comparable"),
    ],
)
def test_the_rule(published: float | None, direction: Direction, within: float, verdict: Status) -> None:
    assert ten(published, direction, within).verdict == verdict


@given(st.floats(-1e3, 1e3), st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=5), st.floats(0, 1))
def test_directions_mirror_one_another(published: float, values: list[float], within: float) -> None:
    up = row("a", "a", "1", published, values, "higher", within=within)
    down = row("a", "a", "1", -published, [-v for v in values], "lower", within=within)
    assert up.verdict == down.verdict
    assert up.verdict in ("better", "reproduced", "deviates")


def test_a_claim_is_as_good_as_its_worst_row() -> None:
    good, better, bad = ten(9.0, "equal"), ten(5.0, "higher"), ten(15.0, "equal")
    aside = ten(15.0, "equal", comparable=False)
    assert Measurement("s", [good, aside]).status == "reproduced"
    assert Measurement("s", [good, better]).status == "better"
    assert Measurement("s", [good, better, bad]).status == "deviates"
    assert Measurement("s", [aside, ten(None, "equal")]).status == "not comparable"


def test_the_reason_names_the_rows_that_decided_and_the_notes() -> None:
    bad = row("room.seconds", "time", "s", 1.0, [3.0], "lower")
    why = Measurement("s", [ten(9.0, "equal"), bad], ("another scene",)).why
    assert why == "1 of 2 compared figures hold: room.seconds = 3 [3, 3], published at most 1. another scene."


def test_two_rows_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="not unique"):
        Answer.of("toy", Measurement("s", [ten(1.0, "equal"), ten(2.0, "equal")]), "none")


def test_no_values_and_negative_tolerances_are_refused() -> None:
    with pytest.raises(ValueError, match="no values"):
        row("a", "a", "1", 1.0, [])
    with pytest.raises(ValueError, match="within"):
        row("a", "a", "1", 1.0, [1.0], within=-0.1)


def test_every_claim_says_what_it_is_and_where_it_was_published() -> None:
    claims = registered_claims()
    assert "flc-table-4.1" in claims
    for name, claim in claims.items():
        assert claim.id == name
        assert claim.title
        assert claim.source
