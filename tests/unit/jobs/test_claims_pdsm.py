"""The published tables of penumbra deep shadow maps: registered, and every row and rule of a small stage."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.claims import Bench, registered_claims
from jobs.claims import pdsm_tables as tables
from jobs.claims.pdsm_stage import Model, ball, bytes_of_steps, knot, peak_bytes, scanned_model, stage_of


@pytest.fixture
def bench() -> Bench:
    """A bench that says nothing."""
    return Bench(lambda line: None)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables over few samples of a sphere, with few pixels."""
    build = tables.Stage.build

    def tiny(self: tables.Stage, samples: int, resolution: int, maps: int, *args: object, **how: object) -> object:
        return build(self, max(samples // 16, 1), resolution // 16, maps // 16, *args, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(tables.Stage, "build", tiny)
    monkeypatch.setattr(tables, "scanned_model", lambda bench: ball(12))
    monkeypatch.setattr(tables, "foliage", lambda bench: ball(12))
    monkeypatch.setattr(tables, "FRAME_SIZE", (32, 24))


def test_all_tables_are_registered() -> None:
    """3.1 to 3.8 and 4.1."""
    known = registered_claims()
    assert {f"pdsm-table-{n}" for n in ("3.1", "3.2", "3.3", "3.4", "3.5", "3.6", "3.7", "3.8", "4.1")} <= set(known)


def test_construction_times_have_the_asked_row(bench: Bench, small: None) -> None:
    """`n256.pdsm512.seconds` is compared, other seconds are shown only."""
    found = tables.times(bench)
    rows = {r.id: r for r in found.rows}
    assert len(rows) == 5 * 3 + 2
    assert rows["n256.pdsm512.seconds"].published == 147
    assert rows["n256.pdsm512.seconds"].verdict == "better"
    assert {r.id for r in found.rows if r.verdict != "not comparable"} == {
        "n256.pdsm512.seconds",
        "growth.samples",
        "growth.resolution",
    }


@pytest.mark.parametrize("table", ["light_times", "map_times", "slab_times", "memory"])
def test_other_tables_answer_positive_figures(table: str, bench: Bench, small: None) -> None:
    """Unique ids, a figure in every row, and a published one beside it."""
    found = getattr(tables, table)(bench)
    assert len({r.id for r in found.rows}) == len(found.rows)
    assert all(r.published is not None and r.published > 0 and r.measured.mean >= 0 for r in found.rows)


def test_sizes_and_ratios(bench: Bench, small: None) -> None:
    """Four sizes for each number of samples, and three ratios of the last."""
    found = tables.sizes(bench, tables.DRAGON_MB, lambda bench: ball(12))
    rows = {r.id: r.measured.mean for r in found.rows}
    assert len(rows) == 5 * 4 + 3
    assert rows["n256.uncompressed.mib"] / rows["n256.eps5.mib"] == pytest.approx(rows["n256.eps5.ratio"])
    assert rows["n256.eps2.mib"] >= rows["n256.eps5.mib"] >= rows["n256.eps10.mib"]


def test_the_stage_holds_everything_in_one_pyramid_and_its_ground_casts_nothing() -> None:
    """Between model and ground some light is hidden, beside the model none, and nowhere by the ground itself."""
    stage = stage_of(ball(16))
    made = stage.build(16, 64, 64)
    p = made.pyramid
    local = p.local(stage.world.positions[stage.world.triangles[stage.casters]])
    assert (np.abs(local[..., 0]) < local[..., 2]).all()
    assert made.value.max() == 1
    corner = stage.world.positions[stage.world.triangles[~stage.casters]].reshape(-1, 3) * 0.98
    assert made.hidden(corner).max() == 0
    assert bytes_of_steps(stage.build(16, 64, 64, compression="none")) < stage.build(16, 64, 64, compression="none").bytes


def test_models(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a scene folder a knot of more than 100,000 triangles stands in; its surface is closed."""
    monkeypatch.delenv("LUXMETER_SCENES", raising=False)
    model: Model = scanned_model(bench)
    assert "procedural" in model.name
    assert len(model.triangles) > 100_000
    few = knot(30, 8)
    edges = np.sort(np.concatenate([few.triangles[:, [0, 1]], few.triangles[:, [1, 2]], few.triangles[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_peak_memory_of_an_allocation() -> None:
    """64 MiB that were written to."""
    assert peak_bytes(lambda: np.ones(8 << 20)) == pytest.approx(64 << 20, rel=0.1)
