"""Files that are either whole or not there."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`, with the same suffix, that becomes `path` when the block ends without an exception."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{threading.get_ident()}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_model(path: Path, model: BaseModel) -> None:
    """Write a pydantic model as indented JSON, whole."""
    write_text(path, model.model_dump_json(indent=2) + "\n")


def safe_name(text: str) -> str:
    """`text` as a part of file names and addresses: letters, digits, dot, dash and underscore."""
    return re.sub(r"-{2,}", "-", re.sub(r"[^A-Za-z0-9._-]", "-", text)).strip("-.") or "x"
