"""Published figures of forward light cuts, measured by `luxmeter reproduce`."""

from __future__ import annotations

import json

import pytest

from service.cli import run

pytestmark = [pytest.mark.slow, pytest.mark.gl, pytest.mark.mitsuba]


def test_table_4_1_holds_at_64k_lights(capfd: pytest.CaptureFixture[str]) -> None:
    """≥ 4.3 times fewer light evaluations than ir, at SSIM ≥ 0.9875 and over 2 % ≤ 4.44 % against it."""
    assert run(["reproduce", "flc-table-4.1", "--json"]) == 0
    (answer,) = json.loads(capfd.readouterr().out)
    rows = {r["id"]: r for r in answer["rows"]}
    assert rows["flc64k.evaluations_ratio"]["low"] >= 4.3
    assert rows["flc64k.ssim_vs_ir"]["low"] >= 0.9875
    assert rows["flc64k.over_2pct_vs_ir"]["high"] <= 0.0444
