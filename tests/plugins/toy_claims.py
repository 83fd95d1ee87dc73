"""Claims without renders, to test what measures claims. Named in LUXMETER_PLUGINS."""

from __future__ import annotations

import sys
import time

from jobs.claims import Bench, Measurement, PublishedClaim, register, row


def true(bench: Bench) -> Measurement:
    """Holds exactly."""
    bench.report("counting")
    print("libraries write to stdout as they like")
    return Measurement("a toy", [row("one.count", "number of ones", "1", 1.0, [1.0, 1.0])], ("counted by hand",))


def broken(bench: Bench) -> Measurement:
    """Fails."""
    raise ValueError("no such table")


def endless(bench: Bench) -> Measurement:
    """Never ends."""
    time.sleep(60)
    sys.exit("slept")


register(PublishedClaim("toy-true", "Toy claim that holds", "luxmeter's tests", true))
register(PublishedClaim("toy-broken", "Toy claim that fails", "luxmeter's tests", broken))
register(PublishedClaim("toy-endless", "Toy claim that never ends", "luxmeter's tests", endless))
