"""What the page shows of a sequence: plots over frames, moving pictures, the worst frame of each row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from renderers.images import write_png
from reports.folder import SceneInfo
from reports.frame_plots import panels, style, write_panel
from reports.preview import write_preview
from reports.rows import Row
from reports.sequences import is_sequence, worst
from reports.stored import Images
from reports.tables import sequence_table
from reports.viewer import write_difference

FIRST_PLOTS = 4  # error, flicker, time and one counter; the others are folded away


def sequence_context(images: Images, scene: SceneInfo, rows: Sequence[Row], assets: Path, prefix: str) -> dict[str, Any] | None:
    """Write a scene's plots and pictures over frames below `assets`; what the template needs. None without a sequence."""
    rows = [row for row in rows if is_sequence(row)]
    if not rows:
        return None
    for name in ("plots", "sequence"):
        (assets / name).mkdir(exist_ok=True)
    plots = [
        {"title": panel.title, "axis": panel.axis, **write_panel(panel, assets / "plots" / f"{prefix}-frames")}
        for panel in panels(rows)
    ]
    return {
        "table": sequence_table(rows),
        "legend": [_key(index, row) for index, row in enumerate(rows)],
        "plots": plots[:FIRST_PLOTS],
        "more": plots[FIRST_PLOTS:],
        "preview": write_preview(images, scene, rows, assets / "sequence" / f"{prefix}-preview"),
        "worst": [shown for row in rows if (shown := _worst(images, scene, row, assets, prefix)) is not None],
    }


def _key(index: int, row: Row) -> dict[str, str]:
    colour, dashes = style(index)
    return {"label": row.label, "colour": colour, "dashes": "" if dashes == "-" else " ".join(str(2 * d) for d in dashes[1])}


def _worst(images: Images, scene: SceneInfo, row: Row, assets: Path, prefix: str) -> dict[str, Any] | None:
    """The row's worst frame beside its reference and the error between them; None without them."""
    found = worst(row)
    if found is None:
        return None
    cell, error = found
    test, reference = images.frame(cell), images.reference(scene.name, cell.frame, row.transport, row.size)
    if test is None or reference is None:
        return None
    stem = f"{prefix}-{row.key}-worst"
    folder = assets / "sequence"
    write_png(folder / f"{stem}.png", test, scene.exposure)
    write_png(folder / f"{stem}-reference.png", reference.mean, scene.exposure)
    write_difference(folder / f"{stem}-error.png", test, reference.mean)
    names = {"test": f"{stem}.png", "reference": f"{stem}-reference.png", "error": f"{stem}-error.png"}
    return {"row": row, "cell": cell, "error": error, "files": names}
