"""What commands print and where they write."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from jobs.errors import RequestError

OURS = ("evaluation.json", "result.json", "reference.json", "run.json", "comparison.json")
WIDE = 200  # columns of a table that goes into a file or a pipe
console = Console(stderr=True, soft_wrap=True)


def print_json(document: Any) -> None:
    """Write the one JSON document of this command to stdout."""
    sys.stdout.write(json.dumps(document, indent=2, allow_nan=False) + "\n")
    sys.stdout.flush()


def print_table(columns: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """Write a plain table to stdout."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in columns:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*row)
    terminal = sys.stdout.isatty()
    Console(file=sys.stdout, width=None if terminal else WIDE).print(table, markup=False)


@contextlib.contextmanager
def staged(out: Path, *, force: bool) -> Iterator[Path]:
    """A folder beside `out` to work in, which becomes `out` when the block ends well and is removed otherwise.

    Raises RequestError where `out` holds something, unless `force` is given and it holds an earlier output of luxmeter.
    """
    check_free(out, force=force)
    out = out.resolve()
    stage = out.with_name(f".{out.name}.{os.getpid()}.partial")
    try:
        stage.mkdir(parents=True)
        yield stage
        if out.exists():
            shutil.rmtree(out)
        stage.rename(out)
    except OSError as error:
        raise RequestError(f"can't write {out}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def check_free(out: Path, *, force: bool) -> None:
    """Raises RequestError where `staged(out)` would; called before any work."""
    if out.exists() and not out.is_dir():
        raise RequestError(f"{out} is a file; --out takes a folder")
    if not out.is_dir() or not any(out.iterdir()):
        return
    if not force:
        raise RequestError(f"{out} is not empty; --force replaces an earlier output of luxmeter")
    if not any((out / name).is_file() for name in OURS):
        raise RequestError(f"{out} holds something that luxmeter did not write; choose another folder")
