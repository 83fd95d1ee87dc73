"""Plots over the frames of a sequence, one SVG a quantity, for light and for dark pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reports import sequences
from reports.plots import COLOURS, THEMES, Theme, themed
from reports.rows import Row
from reports.sequences import Read, Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)))
WIDE = 200.0  # from this ratio on only powers of ten are labelled
LOG_FROM = 30.0  # a greater ratio of the largest to the smallest positive value is drawn on a logarithmic axis


@dataclass(frozen=True)
class Panel:
    """One plot: what it shows, the axis, a line for each row, and as thin lines what the references' noise alone produces."""

    id: str
    title: str
    axis: str
    lines: tuple[Series, ...]
    floors: tuple[Series, ...] = ()


def style(index: int) -> tuple[str, Any]:
    """Colour and dashes of the row of this index."""
    return COLOURS[index % len(COLOURS)], DASHES[index // len(COLOURS) % len(DASHES)]


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Error, flicker, time and the counters that change; without those that nobody measured."""

    def of(read: Read) -> tuple[Series, ...]:
        return tuple(sequences.series(row, read) for row in rows)

    found = [
        Panel("rmse", "Error", "RMSE (0–255)", of(sequences.matched("rmse")), of(sequences.matched_floor("rmse"))),
        Panel("flicker", "Flicker", "luma (0–255)", of(sequences.matched("flicker")), of(sequences.matched_floor("flicker"))),
        Panel("seconds", "Time", "wall seconds", of(sequences.wall_seconds)),
    ]
    for name in sequences.changing_counters(rows):
        words = name.replace("_", " ")
        found.append(Panel(f"counter-{name}", words[:1].upper() + words[1:], "count", of(sequences.counter(name))))
    return [panel for panel in found if any(line.values for line in panel.lines)]


def write_panel(panel: Panel, stem: Path) -> dict[str, str]:
    """Write `<stem>-<id>-light.svg` and `-dark.svg`; their names, keyed light and dark."""
    from matplotlib.figure import Figure

    names = {}
    for theme in THEMES:
        with themed(theme):
            figure = Figure(figsize=(5.2, 2.6), layout="constrained")
            _draw(figure.subplots(), panel, theme)
            path = stem.with_name(f"{stem.name}-{panel.id}-{theme.name}.svg")
            figure.savefig(path, format="svg", transparent=True, metadata={"Date": None, "Creator": "luxmeter"})
        names[theme.name] = path.name
    return names


def _limits(panel: Panel) -> tuple[float, float]:
    """The frames of the whole sequence, so that all plots have one axis."""
    frames = [frame for line in panel.lines for frame in line.row.frames]
    margin = 0.02 * (max(frames) - min(frames))
    return min(frames) - margin, max(frames) + margin


def _draw(axes: Axes, panel: Panel, theme: Theme) -> None:
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    axes.set(title=panel.title, xlim=_limits(panel), xlabel="frame", ylabel=panel.axis)
    axes.grid(True, which="major", color=theme.faint, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    values = [value for line in panel.lines for value in line.values]
    positive = [value for value in values if value > 0]
    if positive and len(positive) == len(values) and max(positive) > LOG_FROM * min(positive):
        axes.set_yscale("log")
        wide = max(positive) > WIDE * min(positive)
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
    for index, line in enumerate(panel.floors):
        for frames, heights in runs(line):
            axes.plot(frames, heights, color=style(index)[0], linewidth=0.8, alpha=0.5, linestyle=":", zorder=1)
    for index, line in enumerate(panel.lines):
        colour, dashes = style(index)
        for frames, heights in runs(line):
            marker = {"marker": "o", "markersize": 3.5} if len(frames) == 1 else {"linestyle": dashes, "linewidth": 1.4}
            axes.plot(frames, heights, color=colour, zorder=2, **marker)
    if axes.get_yscale() == "linear":
        axes.set_ylim(0, 1.08 * max(values) or 1)


def runs(line: Series) -> list[tuple[list[int], list[float]]]:
    """Consecutive frames: only they are joined, since nothing is known between the others."""
    found: list[tuple[list[int], list[float]]] = []
    for frame, value in zip(line.frames, line.values, strict=True):
        if not found or found[-1][0][-1] != frame - 1:
            found.append(([], []))
        found[-1][0].append(frame)
        found[-1][1].append(value)
    return found
