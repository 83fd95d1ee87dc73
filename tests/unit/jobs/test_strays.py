"""Work that is taken and that nobody is at: found when it was so twice, and never while somebody is at it."""

from __future__ import annotations

from jobs.strays import Stray, Strays

OURS, LOST, THEIRS = Stray("a", "me", 1), Stray("b", "gone", 1), Stray("c", "other", 1)


def test_found_after_the_patience_and_then_once() -> None:
    strays = Strays("me", patience_s=10)
    taken, live = [OURS, LOST, THEIRS], {"me", "other"}
    assert strays.among(taken, live, 0.0) == []
    assert strays.among(taken, live, 9.0) == []
    assert strays.among(taken, live, 10.0) == [OURS, LOST]
    assert strays.among([THEIRS], live, 11.0) == []


def test_who_takes_it_again_gets_the_whole_patience() -> None:
    strays = Strays("me", patience_s=10)
    assert strays.among([LOST], {"me"}, 0.0) == []
    assert strays.among([LOST._replace(since=2)], {"me"}, 10.0) == []
    assert strays.among([], {"me"}, 11.0) == []
    assert strays.among([LOST._replace(since=2)], {"me"}, 20.0) == []


def test_what_we_are_at_is_no_stray() -> None:
    strays = Strays("me", patience_s=10)
    with strays.at_work("a"), strays.at_work("a"):
        assert strays.among([OURS], {"me"}, 0.0) == []
        assert strays.among([OURS], {"me"}, 20.0) == []
    assert strays.among([OURS], {"me"}, 30.0) == []
    assert strays.among([OURS], {"me"}, 40.0) == [OURS]
