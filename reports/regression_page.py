"""The page of a comparison: verdicts, what changed, and both images of every changed row side by side."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.images import write_png
from reports import format as form
from reports.build import HERE, OWN_ASSETS, environment
from reports.change import Comparison, Quantity, RowChange
from reports.folder import Cell
from reports.metrics import Pair, over_states
from reports.regression import LEVEL, Side
from reports.runs import evaluation_folders
from reports.viewer import encode, shown_frames, write_difference

IMAGED = ("regression", "improvement", "undecided", "changed-within-noise")


def write(comparison: Comparison, before: Path | None, after: Path, out: Path, accept: str = "") -> Path:
    """Write `index.html`, `assets/` and `comparison.json` of a comparison into `out`; returns the page's path.

    before, after: the folders that were compared; `accept`: the command that makes the later run the baseline, shown where given.
    The same folders give the same bytes.
    """
    out.mkdir(parents=True, exist_ok=True)
    assets = out / "assets.part"
    shutil.rmtree(assets, ignore_errors=True)
    assets.mkdir()
    for name in OWN_ASSETS:
        shutil.copyfile(HERE / "assets" / name, assets / name)
    shown = context(comparison, write_images(comparison, before, after, assets))
    page = environment().get_template("comparison.html").render(shown, accept=accept, reports=_reports(after, out), assets="assets")
    shutil.rmtree(out / "assets", ignore_errors=True)
    assets.rename(out / "assets")
    for name, text in (("comparison.json", comparison.model_dump_json(indent=2) + "\n"), ("index.html", page)):
        part = out / f"{name}.part"
        part.write_text(text)
        part.replace(out / name)
    return out / "index.html"


def write_images(comparison: Comparison, before: Path | None, after: Path, assets: Path) -> dict[str, Any]:
    """Write the images of every changed row under `assets/data` and `assets/thumbnails`; what viewers need to know, by row key."""
    for name in ("data", "thumbnails"):
        (assets / name).mkdir(parents=True)
    sides = [{part: Side.of(f) for part, f in evaluation_folders(f).items()} if f else {} for f in (before, after)]
    return {row.key: _viewer(row, sides[0][row.part], sides[1][row.part], assets) for row in _imaged(comparison)}


def _imaged(comparison: Comparison) -> list[RowChange]:
    return [row for row in comparison.rows if row.verdict in IMAGED and row.after_cells]


def _reports(after: Path, out: Path) -> list[str]:
    """Names of the parts whose own reports lie under the page's folder."""
    return [name for name, f in evaluation_folders(after).items() if name and f.parent == out and (f / "index.html").is_file()]


def context(comparison: Comparison, viewers: Mapping[str, Any]) -> dict[str, Any]:
    """What `changes.html` shows of a comparison; `viewers` is what `write_images` returned."""
    changed = [row for row in comparison.rows if row.verdict not in ("unchanged", "new", "gone")]
    quiet = [row for row in comparison.rows if row not in changed]
    return {
        "comparison": comparison,
        "changed": [
            {"row": row, "summary": _summary(row), "lines": _lines(row), "viewer": viewers.get(row.key)} for row in changed
        ],
        "quiet": [{"row": row, "time": _quantity(row, "wall_s")} for row in quiet],
        "several_parts": len({row.part for row in comparison.rows}) > 1,
        "level": LEVEL,
        "headline": headline(comparison),
    }


def headline(comparison: Comparison) -> str:
    """The outcome in one sentence."""
    if comparison.before is None:
        return "No run has been accepted yet: there is nothing to compare with."
    counts = dict(comparison.counts)
    newly = sum(row.newly_failed for row in comparison.rows)
    moved = sum(reference.verdict == "regression" for reference in comparison.references)
    bad = [
        f"{counts.get('regression', 0)} of {len(comparison.rows)} rows got worse beyond noise" if counts.get("regression") else "",
        f"{newly} row{'s' if newly != 1 else ''} newly failed" if newly else "",
        f"{moved} reference{'s' if moved != 1 else ''} moved" if moved else "",
    ]
    if any(bad):
        return ", ".join(b for b in bad if b) + "."
    if set(counts) <= {"unchanged"}:
        return f"Every image is the same to the last byte ({len(comparison.rows)} rows)."
    return f"Nothing got worse beyond noise ({len(comparison.rows)} rows)."


def _quantity(row: RowChange, key: str) -> Quantity | None:
    return next((q for q in row.quantities if q.id == key), None)


def _summary(row: RowChange) -> list[dict[str, Any]]:
    """Cells of the first table, each with its column's name: RMSE, bias, the counter that moved most, time."""
    counters = [q for q in row.quantities if q.kind == "work" and q.change != 0]
    most = max(counters, key=lambda q: q.size, default=None)
    found = [_quantity(row, "matched.rmse"), _quantity(row, "matched.mean_bias"), most, _quantity(row, "wall_s")]
    cells: list[dict[str, Any]] = []
    for name, quantity in zip(("RMSE", "Bias", "Work", "Time"), found, strict=True):
        if quantity is None:
            cells.append({"name": name, "text": form.DASH, "value": None, "note": "", "direction": "same"})
            continue
        note = f"{written(quantity, quantity.before)} → {written(quantity, quantity.after)}"
        if quantity.kind == "work":
            note = f"{quantity.name}: {note}"
        shown = {"text": change(quantity), "value": quantity.change, "note": note, "direction": quantity.direction}
        cells.append({"name": name, **shown})
    return cells


def _lines(row: RowChange) -> list[dict[str, Any]]:
    """The row's quantities, those that count first and the largest of them first."""
    kinds = ("error", "work", "information")
    found = sorted(row.quantities, key=lambda q: (kinds.index(q.kind), -q.size))
    return [
        {
            "quantity": q, "before": written(q, q.before), "after": written(q, q.after), "change": change(q),
            "interval": _interval(q), "tested": form.number(q.adjusted, 2) if q.adjusted is not None else "",
        }
        for q in found
    ]  # fmt: skip


def written(quantity: Quantity, value: float) -> str:
    """A value in its quantity's unit."""
    if quantity.kind == "work":
        return form.count(round(value)) if value == round(value) else form.number(value, 6)
    if quantity.id == "wall_s":
        return form.seconds(value)
    if quantity.id == "peak_rss_bytes":
        return form.megabytes(round(value))
    if quantity.id.endswith(("mean_bias", "over_2pct")):
        return form.percent(value)
    return form.number(value, 5 if quantity.id.endswith("ssim") else 3)


def change(quantity: Quantity) -> str:
    """The change: relative where that says something, a ratio for times, otherwise the difference."""
    if quantity.id == "wall_s":
        return f"× {form.number(quantity.after / quantity.before)}"
    sign = "+" if quantity.change > 0 else ""
    if quantity.change == 0:
        return "0"
    if quantity.relative is not None and not quantity.id.endswith("over_2pct"):
        return sign + form.percent(quantity.relative)
    return sign + written(quantity, quantity.change)


def _interval(quantity: Quantity) -> str:
    if quantity.low is None or quantity.high is None:
        return "one seed" if quantity.seeds == 1 and quantity.kind != "information" else ""
    if quantity.low == quantity.high:
        return "every seed alike"
    if quantity.id.endswith(("mean_bias", "over_2pct")):
        return f"{form.percent(quantity.low)} … {form.percent(quantity.high)}"
    return f"{form.number(quantity.low)} … {form.number(quantity.high)}"


def _viewer(row: RowChange, before: Side, after: Side, assets: Path) -> dict[str, Any]:
    """Images of the row's first common seed: the later one, the earlier one and the matched reference, frame by frame."""
    cells = [{c.id: c for c in side.evaluation.cells} for side in (before, after)]
    exposure = after.exposures[row.scene]
    frames = []
    for index in shown_frames(range(len(row.frames))):
        olds, new = cells[0][row.before_cells[index]], cells[1][row.after_cells[index]]
        entries = _entries(row, before, after, (olds, new), assets, exposure)
        if entries:
            frames.append({"frame": row.frames[index], "images": entries, "difference": f"{entries[0]['id']}-difference"})
    before.images.forget()
    after.images.forget()
    return {"exposure": exposure, "frames": frames}


def _entries(
    row: RowChange, before: Side, after: Side, cells: tuple[Cell, Cell], assets: Path, exposure: float
) -> list[dict[str, Any]]:
    old, new = before.images.frame(cells[0]), after.images.frame(cells[1])
    if old is None or new is None or old.shape != new.shape:
        return []
    cell, keys = cells[1], [f"{row.key}-f{cells[1].frame}-{name}" for name in ("after", "before", "reference")]
    size = (cell.width, cell.height)
    images = (after.images, before.images)
    truth = next((r for i in images if (r := i.reference(cell.scene, cell.frame, cell.transport, size)) is not None), None)
    over_new = {keys[1]: encode(over_states(Pair(new, old, exposure)))}
    over_old: dict[str, str] = {}
    if truth is not None:
        over_new[keys[2]] = encode(over_states(truth.pair(new, exposure)))
        over_old[keys[2]] = encode(over_states(truth.pair(old, exposure)))
    write_difference(assets / "thumbnails" / f"{keys[0]}-difference.png", new, old)
    seed = f"seed {cell.seed}"
    # The viewer puts an image's `matched` one beside it: the earlier image stands beside the later one.
    entries = [
        _image(keys[0], f"after, {seed}", new, over_new, assets, exposure) | {"kind": "method", "matched": keys[1]},
        _image(keys[1], f"before, {seed}", old, over_old, assets, exposure) | {"kind": "method"},
    ]
    if truth is not None:
        label = f"reference, {truth.info.transport}"
        entries[1]["matched"] = keys[2]
        entries.append(_image(keys[2], label, truth.mean, {}, assets, exposure) | {"kind": "reference"})
    return entries


def _image(
    key: str, label: str, pixels: NDArray[np.float32], over: dict[str, str], assets: Path, exposure: float
) -> dict[str, Any]:
    height, width = pixels.shape[:2]
    data = {"width": width, "height": height, "rgb": encode(pixels.astype("<f4")), "over": over}
    (assets / "data" / f"{key}.js").write_text(f"luxmeter.image({json.dumps(key)},{json.dumps(data)});\n")
    write_png(assets / "thumbnails" / f"{key}.png", pixels, exposure)
    return {"id": key, "label": label, "width": width, "height": height}
