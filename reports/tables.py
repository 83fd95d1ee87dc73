"""Tables: every cell as one line of a data frame (CSV and Parquet), and what the page's tables show."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reports.folder import Evaluation
from reports.format import DASH, count, megabytes, number, of_metric, percent, seconds, uncertainty
from reports.registry import METRICS, Metric
from reports.results import Result
from reports.rows import AGAINST, Against, Row, device_string
from reports.sequences import compared, first_seconds, is_sequence, total_seconds, worst
from reports.verdicts import best_values

if TYPE_CHECKING:
    import pandas as pd

MAIN_METRICS = ("rmse", "ssim", "over_2pct")
SEQUENCE_METRICS = ("rmse", "flicker", "flicker_linear", "ghost_bright", "ghost_dark")
TableCell = dict[str, Any]


def frame(evaluation: Evaluation, results: Mapping[str, Result]) -> pd.DataFrame:
    """One line per cell, failed ones included: identity, metrics `matched.rmse` …, floors, costs, counters, hashes."""
    import pandas as pd

    lines = []
    for cell in evaluation.cells:
        line = cell.model_dump(exclude={"settings"})
        result = results.get(cell.id)
        settings = result.settings if result else cell.settings
        line["settings"] = json.dumps(settings, sort_keys=True)
        if result is not None:
            line |= _measured(result)
        lines.append(line)
    table = pd.DataFrame(lines)
    counters = [c for c in table.columns if c.startswith("counters.")]
    return table.astype(dict.fromkeys(counters, "Int64"))


def _measured(result: Result) -> dict[str, Any]:
    line: dict[str, Any] = {f"{a}.{m}": v for a, row in sorted(result.metrics.items()) for m, v in row.items()}
    line |= {f"noise_floor.{a}.{m}": v for a, row in sorted(result.noise_floor.items()) for m, v in row.items()}
    rendered = [t for t in result.timings if t.get("stage") == "render"]
    line["wall_s"] = result.seconds if rendered else None
    line["cpu_s"] = sum(t["cpu_s"] for t in rendered) if rendered else None
    gpu = [t.get("gpu_s") for t in rendered]
    line["gpu_s"] = sum(g for g in gpu if g is not None) if gpu and None not in gpu else None
    line |= {f"counters.{k}": v for k, v in sorted(result.counters.items())}
    line |= {"peak_rss_bytes": result.peak_rss_bytes, "device": device_string(result), "frame_hash": result.frame_hash}
    return line | {"scene_hash": result.scene_hash, "settings_hash": result.settings_hash, "notes": "; ".join(result.notes)}


def write_tables(folder: Path, evaluation: Evaluation, results: Mapping[str, Result]) -> None:
    """Write `results.csv` and `results.parquet`; equal input gives equal bytes."""
    table = frame(evaluation, results)
    for name, write in (("results.csv", table.to_csv), ("results.parquet", table.to_parquet)):
        part = folder / f"{name}.part"
        write(part, index=False)
        part.replace(folder / name)


def cell(text: str, value: float | str | None = None, note: str = "", *, best: bool = False) -> TableCell:
    """One cell: shown text, the value it sorts by, a second line in small print."""
    return {"text": text, "value": value, "note": note, "best": best}


def metric_cell(row: Row, against: Against, metric: Metric, best: set[str]) -> TableCell:
    """A metric's mean with its uncertainty, and for over 2 % with what the reference leaves open."""
    found = row.interval(against, metric.id)
    if found is None:
        return cell(DASH)
    note = uncertainty(metric, found)
    if metric.id == "over_2pct":
        surely, possibly = (row.interval(against, f"over_2pct_{w}") for w in ("surely", "possibly"))
        if surely is not None and possibly is not None and possibly.mean > surely.mean:
            note = f"[{percent(surely.mean).removesuffix(' %')} … {percent(possibly.mean)}]"
    return cell(of_metric(metric, found.mean), found.mean, note, best=row.key in best)


def main_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Lines of a scene's first table: label, transport, error matched and full, bias, seconds."""
    best = {(a, m): best_values(rows, a, m) for a in AGAINST for m in MAIN_METRICS}
    bias = METRICS["mean_bias"]
    best_bias = best_values(rows, "full", "mean_bias")
    lines = []
    for row in rows:
        cells = [cell(row.transport, row.transport)]
        cells += [metric_cell(row, a, METRICS[m], best[a, m]) for a in AGAINST for m in MAIN_METRICS]
        cells += [metric_cell(row, "full", bias, best_bias), seconds_cell(row)]
        cells.append(cell(str(len({c.seed for c, _ in row.done})), len({c.seed for c, _ in row.done}), _seed_note(row)))
        lines.append({"row": row, "cells": cells})
    return lines


def _seed_note(row: Row) -> str:
    if row.failed:
        return f"{len(row.failed)} failed"
    return "unchanged" if row.unchanged else ""


def seconds_cell(row: Row) -> TableCell:
    """Median wall seconds with the extremes that were measured."""
    if row.seconds is None:
        return cell(DASH)
    low, high = seconds(row.seconds.low), seconds(row.seconds.high)
    low = low.removesuffix(" s") if not high.endswith("ms") else low
    spread = f"{low} … {high}" if row.seconds.n > 1 else ""
    return cell(seconds(row.seconds.median), row.seconds.median, spread)


def cost_table(rows: Sequence[Row]) -> tuple[list[str], list[dict[str, Any]]]:
    """Headings and lines of the work table: wall, CPU and GPU seconds, memory, then every counter that some row has."""
    counters = sorted({name for row in rows for name in row.counters})
    headings = ["Wall", "CPU", "GPU", "Peak memory", *(c.replace("_", " ") for c in counters)]
    lines = []
    for row in rows:
        memory = max((r.peak_rss_bytes for _, r in row.done), default=0)
        cells = [seconds_cell(row)]
        cells += [cell(seconds(row.total(f)), row.total(f)) for f in ("cpu_s", "gpu_s")]
        cells.append(cell(megabytes(memory), memory or None))
        cells += [cell(count(row.counters[c]), row.counters[c]) if c in row.counters else cell(DASH) for c in counters]
        lines.append({"row": row, "cells": cells})
    return headings, lines


def other_metrics_table(rows: Sequence[Row]) -> tuple[list[str], list[dict[str, Any]]]:
    """Headings and lines of the metrics that the first table leaves out, against both references."""
    shown = {*MAIN_METRICS, "over_2pct_surely", "over_2pct_possibly"}
    extra = [m for m in METRICS.values() if m.id not in shown and any(row.values(a, m.id) for row in rows for a in AGAINST)]
    best = {(a, m.id): best_values(rows, a, m.id) for a in AGAINST for m in extra}
    headings = [f"{m.name}, {a}" for a in AGAINST for m in extra]
    lines = [{"row": r, "cells": [metric_cell(r, a, m, best[a, m.id]) for a in AGAINST for m in extra]} for r in rows]
    return headings, lines


def sequence_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Lines of a scene's table over frames: frames, mean and worst error, flicker, ghosts, seconds of all and the first frame."""
    best = {m: best_values(rows, "matched", m) for m in SEQUENCE_METRICS}
    lines = []
    for row in (row for row in rows if is_sequence(row)):
        frames, measured, found = len(row.frames), len(compared(row)), worst(row)
        cells = [cell(str(frames), frames, "all compared" if measured == frames else f"{measured} compared")]
        cells.append(metric_cell(row, "matched", METRICS["rmse"], best["rmse"]))
        cells.append(cell(number(found[1]), found[1], f"frame {found[0].frame}") if found else cell(DASH))
        for metric in SEQUENCE_METRICS[1:]:
            made = metric_cell(row, "matched", METRICS[metric], best[metric])
            floor = row.floor("matched", metric)
            if floor and made["value"] is not None and metric.startswith("flicker"):
                made["note"] = f"noise {of_metric(METRICS[metric], floor)}"
            cells.append(made)
        whole = total_seconds(row)
        cells.append(cell(seconds(whole), whole, f"first {seconds(first_seconds(row))}"))
        lines.append({"row": row, "cells": cells})
    return lines


def settings_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Lines of the settings table: name, value per row (a dash where the method has no such setting), and whether they differ."""
    names = sorted({name for row in rows for name in row.settings})
    lines = []
    for name in names:
        values = [json.dumps(row.settings[name]).strip('"') if name in row.settings else DASH for row in rows]
        lines.append({"name": name, "values": values, "differs": len(set(values)) > 1})
    return lines


def overview(rows: Mapping[str, Sequence[Row]]) -> tuple[list[str], list[dict[str, Any]]]:
    """Labels, and per scene one cell a label: RMSE against the matched reference, the full one in small print."""
    labels = list(dict.fromkeys(row.label for scene in rows.values() for row in scene))
    lines = []
    for scene, own in rows.items():
        best = best_values(own, "matched", "rmse")
        by_label = {row.label: row for row in reversed(own)}
        cells = []
        for label in labels:
            row = by_label.get(label)
            matched, full = (row.interval(a, "rmse") if row else None for a in AGAINST)
            note = f"full {number(full.mean)}" if full else ("failed" if row and not row.done else "")
            value = matched.mean if matched else None
            cells.append(cell(number(value), value, note, best=row is not None and row.key in best))
        lines.append({"scene": scene, "cells": cells})
    return labels, lines
