"""The published claims of photon-mapped irradiance caching, measured with fewer photons."""

from __future__ import annotations

import pytest

from jobs.claims import pmic_tables
from jobs.claims.bench import Bench
from jobs.claims.registry import get_claim


def bench() -> Bench:
    return Bench(report=lambda line: None)


def test_boundary_bias_is_reproduced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pmic_tables, "BORDER_PHOTONS", 200_000)
    found = get_claim("pmic-boundary-bias").measure(bench())
    rows = {row.id: row for row in found.rows}
    assert found.status == "reproduced"
    assert rows["disc"].measured.mean == pytest.approx(0.79, abs=0.02)
    assert abs(rows["corrected"].measured.mean - 1) < 0.01
    assert rows["disc"].verdict == "not comparable"


def test_timing_has_the_rows_others_rely_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pmic_tables, "PHOTONS", 100_000)
    monkeypatch.setattr(pmic_tables, "REPEATS", 2)
    found = get_claim("pmic-timing").measure(bench())
    assert [row.id for row in found.rows] == ["photon_seconds", "records", "record_seconds", "record_ms"]
    assert all(row.measured.mean > 0 for row in found.rows)
    assert {row.verdict for row in found.rows if row.unit in ("s", "ms")} == {"not comparable"}
