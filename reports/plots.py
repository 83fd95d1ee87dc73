"""Speed against error as SVG: both axes logarithmic, one picture per device, for light and for dark pages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reports.rows import AGAINST, PATH_TRACER, Against, Row
from reports.statistics import Interval, pareto

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's colours, which stay apart for colour-blind readers; black and yellow are left out: they vanish on one of the
# pages.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
MARKERS = "osD^vPX*<>"
LEAST_ERROR = 1e-3  # where an error of exactly 0 is drawn on the logarithmic axis
STYLE = {"svg.hashsalt": "luxmeter", "svg.fonttype": "none", "font.size": 9, "text.parse_math": False}
TITLES = {"matched": "against the method's own transport", "full": "against full transport"}


@dataclass(frozen=True)
class Theme:
    """Colours of lines and text on one kind of page."""

    name: str
    ink: str
    faint: str


THEMES = (Theme("light", "#1d2433", "#c4c9d4"), Theme("dark", "#e4e7ee", "#4a5266"))


@dataclass(frozen=True)
class Point:
    """One row in the plot: wall seconds and RMSE with its interval."""

    row: Row
    seconds: float
    error: Interval
    colour: str
    marker: str


def points(rows: Sequence[Row], against: Against) -> list[Point]:
    """Rows that have both a time and an error; colour tells methods apart, the marker their settings."""
    methods = list(dict.fromkeys(r.method for r in rows))
    found = []
    for k, row in enumerate(rows):
        error = row.interval(against, "rmse")
        if error is not None and row.seconds is not None and row.seconds.median > 0:
            colour = COLOURS[methods.index(row.method) % len(COLOURS)]
            found.append(Point(row, row.seconds.median, error, colour, MARKERS[k % len(MARKERS)]))
    return found


def speed_against_error(rows: Sequence[Row], stem: Path) -> list[str]:
    """Write `<stem>-light.svg` and `<stem>-dark.svg` for rows of one device; returns their names, none without measurements."""
    if not any(points(rows, against) for against in AGAINST):
        return []
    from matplotlib.figure import Figure

    names = []
    for theme in THEMES:
        with themed(theme):
            figure = Figure(figsize=(10.4, 3.9), layout="constrained")
            left, right = figure.subplots(1, 2, sharex=True)
            for axes, against in ((left, AGAINST[0]), (right, AGAINST[1])):
                _panel(axes, rows, against, theme)
            left.set_xlim(*_limits([p.seconds for p in points(rows, AGAINST[0]) + points(rows, AGAINST[1])]))
            handles = {str(h.get_label()): h for axes in (left, right) for h in axes.get_legend_handles_labels()[0]}
            figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4, frameon=False)
            path = stem.with_name(f"{stem.name}-{theme.name}.svg")
            figure.savefig(path, format="svg", transparent=True, metadata={"Date": None, "Creator": "luxmeter"})
        names.append(path.name)
    return names


@contextmanager
def themed(theme: Theme) -> Iterator[None]:
    """Draw in the colours of a page, from matplotlib's own defaults: a user's matplotlibrc doesn't change the report."""
    import matplotlib as mpl

    colours = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    style: Any = {**STYLE, **dict.fromkeys(colours, theme.ink)}
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(style)
        yield


def _panel(axes: Axes, rows: Sequence[Row], against: Against, theme: Theme) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    found = points(rows, against)
    axes.set(xscale="log", yscale="log", title=TITLES[against], xlabel="wall seconds", ylabel="RMSE (0–255)")
    axes.grid(True, which="major", color=theme.faint, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    if not found:
        axes.text(0.5, 0.5, "nothing measured", ha="center", va="center", transform=axes.transAxes)
        return
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())
    floors = [f for p in found if (f := p.row.floor(against)) is not None and f > 0]
    # Before anything is drawn: one point alone has no extent, and a line across it would ask matplotlib for one.
    axes.set_xlim(*_limits([p.seconds for p in found]))
    axes.set_ylim(*_limits([y for p in found for y in _extent(p)] + floors))
    _path_tracing(axes, found)
    for point in found:
        _draw(axes, point)
    front = [found[i] for i in pareto([(p.seconds, p.error.mean) for p in found])]
    steps = [(p.seconds, max(p.error.mean, LEAST_ERROR)) for p in front]
    axes.step(*zip(*steps, strict=True), where="post", color=theme.ink, linewidth=1, linestyle=":", label="Pareto front", zorder=1)
    for k, floor in enumerate(sorted(set(floors))):
        label = "reference noise floor" if k == 0 else None
        axes.axhline(floor, color=theme.ink, linewidth=0.8, linestyle=(0, (6, 3)), alpha=0.6, label=label)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """Range of a logarithmic axis: the values with a margin, at least a decade wide; a single point stands in the middle."""
    low, high = min(values), max(values)
    margin = max((10.0 * low / high) ** 0.5, 1.25)
    return low / margin, high * margin


def _extent(point: Point) -> list[float]:
    """Heights that a point needs: its mean and its interval, the lower end no further than a decade down."""
    y = max(point.error.mean, LEAST_ERROR)
    return [y, max(point.error.high, y), max(point.error.low, y / 10)]


def _path_tracing(axes: Axes, found: Sequence[Point]) -> None:
    """Join path tracing's measured points, one line per transport and size; no other method's points are joined."""
    curves: dict[tuple[str, tuple[int, int]], list[Point]] = {}
    for point in found:
        if point.row.method == PATH_TRACER:
            curves.setdefault((point.row.transport, point.row.size), []).append(point)
    for curve in curves.values():
        ordered = sorted(curve, key=lambda p: p.seconds)
        x, y = [p.seconds for p in ordered], [max(p.error.mean, LEAST_ERROR) for p in ordered]
        axes.plot(x, y, color=ordered[0].colour, linewidth=1.2, alpha=0.7, zorder=2)


def _draw(axes: Axes, point: Point) -> None:
    mean = point.error.mean
    y = max(mean, LEAST_ERROR)
    down, up = max(min(mean - point.error.low, 0.999 * y), 0.0), max(point.error.high - mean, 0.0)
    assert point.row.seconds is not None, "points have a time"
    span = point.row.seconds
    label = point.row.label + (" (error 0)" if mean < LEAST_ERROR else "")
    axes.errorbar(
        [point.seconds],
        [y],
        yerr=[[down], [up]],
        xerr=[[point.seconds - span.low], [span.high - point.seconds]],
        color=point.colour,
        linestyle="none",
        elinewidth=1,
        capsize=2,
        zorder=3,
    )
    axes.plot([point.seconds], [y], color=point.colour, marker=point.marker, markersize=7, linestyle="none", label=label, zorder=4)
