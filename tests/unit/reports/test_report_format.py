"""Numbers as the report shows them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from reports import format as form
from reports.registry import METRICS
from reports.statistics import interval


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (1.2345, "1.23"),
        (12.345, "12.3"),
        (1234.5, "1234"),
        (0.0012345, "0.00123"),
        (-2.5, "−2.50"),
        (1e-7, "1.00e-07"),
        (3.2e9, "3.20e+09"),
    ],
)
def test_number(value: float | None, text: str) -> None:
    assert form.number(value) == text


def test_shares_are_per_cent() -> None:
    assert form.percent(0.254) == "25.4 %"
    assert form.percent(0.00024) == "0.024 %"
    assert form.of_metric(METRICS["over_2pct"], 1.0) == "100 %"
    assert form.percent(None) == "–"


def test_ssim_keeps_the_digits_that_matter() -> None:
    assert form.of_metric(METRICS["ssim"], 0.99276) == "0.9928"
    assert form.of_metric(METRICS["ssim"], None) == "–"


def test_uncertainty_says_what_it_is() -> None:
    rmse = METRICS["rmse"]
    assert form.uncertainty(rmse, interval([1.0])) == "one seed"
    assert form.uncertainty(rmse, interval([1.0, 1.0])) == "seeds equal"
    assert form.uncertainty(rmse, interval([1.0, 2.0, 3.0])) == "± 2.5"


def test_units() -> None:
    assert form.seconds(0.0123) == "12.3 ms"
    assert form.seconds(2.5) == "2.50 s"
    assert form.megabytes(300 << 20) == "300 MiB"
    assert form.megabytes(0) == "–"
    assert form.count(1234567) == "1\u202f234\u202f567"


def test_contracts_import_nothing_heavy() -> None:
    heavy = {"matplotlib", "pandas", "jinja2", "skimage", "scipy", "flip_evaluator", "mitsuba", "moderngl", "numba", "OpenEXR"}
    code = f"import sys, reports, reports.results, reports.folder; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
