"""Benchmarks of several parts, each a table whose rows appear as they are measured, and pictures of such tables."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

Row = tuple[object, ...]


class Part(NamedTuple):
    """rows: measures and yields them. header: names of their columns."""

    rows: Callable[[], Iterable[Row]]
    header: tuple[str, ...]


def parser_of(description: str | None, parts: Iterable[str]) -> argparse.ArgumentParser:
    """Options --out (a folder) and --part (repeatable; default: all)."""
    parser = argparse.ArgumentParser(description=(description or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    parser.add_argument("--part", choices=list(parts), action="append")
    return parser


def write(parts: Mapping[str, Part], asked: Iterable[str] | None, folder: Path, prefix: str) -> dict[str, Path]:
    """Measure the asked parts, or all: FOLDER/PREFIX_PART.csv of each, whose rows are printed too. Returns the files by part."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {name: folder / f"{prefix}_{name}.csv" for name in asked or parts}
    for name, path in files.items():
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(parts[name].header)
            for row in parts[name].rows():
                writer.writerow(row)
                file.flush()
                print(*row, flush=True)
    return files


def draw_errors(table: Path, picture: Path, first: str, seconds: str = "CPU seconds a frame") -> None:
    """Error against CPU seconds, logarithmic, a panel a scene, of columns scene, curve, cpu_s, error. first: the bold curve."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    scenes, curves = (list(dict.fromkeys(row[name] for row in rows)) for name in ("scene", "curve"))
    figure, axes = pyplot.subplots(1, len(scenes), figsize=(3.5 * len(scenes), 3.6), squeeze=False, layout="constrained")
    for ax, scene in zip(axes.flat, scenes, strict=True):
        for curve in sorted(curves, key=lambda name: name != first):
            own = sorted((float(r["cpu_s"]), float(r["error"])) for r in rows if (r["scene"], r["curve"]) == (scene, curve))
            ax.plot(*zip(*own, strict=True), marker="o", ms=3, lw=2 if curve == first else 1, label=curve)
        ax.set(xscale="log", yscale="log", title=scene)
        ax.grid(alpha=0.3, which="both", lw=0.4)
    figure.supxlabel(seconds)
    figure.supylabel("RMSE of indirect light over its mean")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=8)
    figure.savefig(picture, dpi=110)
    pyplot.close(figure)
