"""Images and result rows in; metrics, verdicts, tables, plots and a static HTML report out. Knows no queue and no HTTP.

`compare` measures one image against one reference, `measure_change` the change from one frame to the next; `noise_floor` and
`flicker_floor` say what the references' own noise would measure; `write` turns
an evaluation folder (`reports.folder`) into a report that opens from disk. The metrics are defined once, in `reports.registry`.
"""

from __future__ import annotations

from pathlib import Path

from reports.comparison import Noise, compare, flicker_floor, measure, measure_change, noise_floor

__all__ = ["Noise", "compare", "flicker_floor", "measure", "measure_change", "noise_floor", "write"]


def write(folder: Path) -> Path:
    """Write the report of an evaluation folder into it and return the path of `index.html`; see `reports.build.write`."""
    from reports.build import write as build

    return build(folder)
