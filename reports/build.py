"""Write the static report of an evaluation folder: `index.html`, `assets/`, `results.csv`, `results.parquet`.

The report is a pure function of the folder: the same folder gives the same bytes. It opens from disk and loads nothing from
elsewhere.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from reports import format as form
from reports import tables
from reports.evidence import Evidence, bars
from reports.folder import Cell, Evaluation, SceneInfo, read
from reports.plots import speed_against_error
from reports.registry import METRICS
from reports.results import NOT_DETERMINISTIC, Result
from reports.rows import Row, gather
from reports.sequence_page import sequence_context
from reports.stored import Images
from reports.verdicts import summary
from reports.viewer import write_viewer

HERE = Path(__file__).parent
OWN_ASSETS = ("report.css", "report.js", "viewer.js")


def write(folder: Path) -> Path:
    """Write the report into `folder` (layout: `reports.folder`) and return the path of `index.html`.

    Failed cells are listed with their errors. An older report is replaced as a whole. Raises FileNotFoundError without
    `evaluation.json`, pydantic.ValidationError when it or a result doesn't hold to the contract.
    """
    evaluation, results = read(folder)
    assets = folder / "assets.part"
    shutil.rmtree(assets, ignore_errors=True)
    assets.mkdir()
    for name in OWN_ASSETS:
        shutil.copyfile(HERE / "assets" / name, assets / name)
    rows = gather(evaluation, results)
    images = Images(folder, evaluation)
    scenes = [_scene(images, evaluation, scene, rows[scene.name], assets, f"s{k}") for k, scene in enumerate(evaluation.scenes)]
    page = environment().get_template("report.html").render(_context(evaluation, results, rows, scenes))
    tables.write_tables(folder, evaluation, results)
    shutil.rmtree(folder / "assets", ignore_errors=True)
    assets.rename(folder / "assets")
    part = folder / "index.html.part"
    part.write_text(page)
    part.replace(folder / "index.html")
    return folder / "index.html"


def environment() -> Environment:
    """Jinja with the filters of the pages."""
    environment = Environment(
        loader=FileSystemLoader(HERE / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"number": form.number, "percent": form.percent, "seconds": form.seconds, "url": quote}
    return environment


def _context(
    evaluation: Evaluation, results: Mapping[str, Result], rows: Mapping[str, Sequence[Row]], scenes: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    labels, lines = tables.overview(rows)
    states = [c.state for c in evaluation.cells]
    return {
        "evaluation": evaluation,
        "scenes": scenes,
        "overview": {"labels": labels, "lines": lines},
        "devices": list(dict.fromkeys(row.device for own in rows.values() for row in own if row.device)),
        "versions": _distinct(results, "versions"),
        "device_fields": _distinct(results, "device"),
        "cells": {"total": len(states), "done": states.count("done"), "failed": states.count("failed")},
        "methods": len({row.label for own in rows.values() for row in own}),
        "metrics": list(METRICS.values()),
    }


def _distinct(results: Mapping[str, Result], field: str) -> dict[str, list[str]]:
    """Every value that a mapping field takes over the results, by name, sorted by name."""
    found: dict[str, dict[str, None]] = {}
    for result in results.values():
        for name, value in getattr(result, field).items():
            found.setdefault(name, {})[value] = None
    return {name: list(values) for name, values in sorted(found.items())}


def _scene(images: Images, evaluation: Evaluation, scene: SceneInfo, rows: list[Row], assets: Path, prefix: str) -> dict[str, Any]:
    evidence = Evidence(images, scene)
    budgets = [(row, found) for row in rows if (found := evidence.budget(row)) is not None]
    zero, stacks = bars(budgets)
    context = {
        "id": prefix,
        "info": scene,
        "rows": rows,
        "summary": summary(rows, evidence.decides),
        "main": tables.main_table(rows),
        "other": tables.other_metrics_table(rows),
        "costs": tables.cost_table(rows),
        "settings": tables.settings_table(rows),
        "plots": _plots(rows, assets, prefix),
        "budgets": {"zero": zero, "stacks": stacks},
        "sequence": sequence_context(images, scene, rows, assets, prefix),
        "viewer": write_viewer(images, scene, rows, assets, prefix),
        "failed": _failures(rows),
        "waiting": [cell for row in rows for cell in row.failed if cell.state != "failed"],
        "references": [r for r in evaluation.references if r.scene == scene.name],
        "aliasing": _aliasing(scene),
        "files": _files(images.folder, rows),
        "unreliable": _not_deterministic(evaluation, scene, rows),
        "remarks": [(row.label, row.sentences("approximations"), row.sentences("notes")) for row in rows if row.done],
    }
    images.forget()
    return context


def _not_deterministic(evaluation: Evaluation, scene: SceneInfo, rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Determinism failures of rows and references: what they are of, and the note."""
    named = [(row.label, row.sentences("notes")) for row in rows]
    named += [(f"reference {r.id}", r.notes) for r in evaluation.references if r.scene == scene.name]
    return [(name, note) for name, notes in named for note in notes if note.startswith(NOT_DETERMINISTIC)]


def _plots(rows: Sequence[Row], assets: Path, prefix: str) -> list[dict[str, Any]]:
    """Speed against error, one plot a device: times of different devices don't share a curve."""
    (assets / "plots").mkdir(exist_ok=True)
    found = []
    for k, device in enumerate(dict.fromkeys(row.device for row in rows if row.device)):
        names = speed_against_error([r for r in rows if r.device == device], assets / "plots" / f"{prefix}-{k}")
        if names:
            found.append({"device": device, "light": names[0], "dark": names[1]})
    return found


def _failures(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Failed cells, those of one row with the same error in one line."""
    found: dict[tuple[str, str], list[Cell]] = {}
    for row in rows:
        for cell in row.failed:
            if cell.state == "failed":
                found.setdefault((row.label, cell.error or "no message"), []).append(cell)
    lines = []
    for (label, error), cells in found.items():
        seeds, frames = sorted({c.seed for c in cells}), sorted({c.frame for c in cells})
        lines.append({"label": label, "error": error, "seeds": seeds, "frames": frames})
    return lines


def _aliasing(scene: SceneInfo) -> str | None:
    """Box against centre reference in one line: error that any image of one sample a pixel has, whatever its method."""
    values = [
        f"{METRICS[m].name} {form.of_metric(METRICS[m], v)}" for m, v in scene.aliasing.items() if m in METRICS and v is not None
    ]
    return ", ".join(values) or None


def _files(folder: Path, rows: Sequence[Row]) -> list[dict[str, Any]]:
    found = []
    for row in rows:
        for cell, result in row.done:
            image = folder / "images" / f"{cell.id}.exr"
            found.append({"cell": cell, "label": row.label, "image": image.is_file(), "hash": result.frame_hash})
    return found
