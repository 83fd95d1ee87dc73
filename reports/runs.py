"""Nightly runs on disk: one folder a run, one evaluation folder a part, and a pointer to the run that was accepted.

HOME/nightly/
  runs/<id>/                   run.json (RunInfo), one evaluation folder a part, comparison.json, index.html, assets/
  accepted/<suite>.json        Baseline: which run later ones are compared with
"""

from __future__ import annotations

import hashlib
import logging
import os
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict

EVALUATION = "evaluation.json"
log = logging.getLogger(__name__)
CONTENT = ("results", "images", "references")


class RunInfo(BaseModel):
    """What `run.json` says of a run. seconds: of the whole run; digest: of its evaluations; baseline: id of the run it was compared
    with; counts: rows by verdict.
    """

    model_config = ConfigDict(extra="forbid")
    id: str
    suite: str
    started: str
    seconds: float
    code: str
    digest: str
    cells: int
    failed: int
    baseline: str | None = None
    counts: dict[str, int] = {}
    regressed: bool = False


class Baseline(BaseModel):
    """The accepted run of a suite: where it lies, and its digest when it was accepted."""

    model_config = ConfigDict(extra="forbid")
    id: str
    suite: str
    folder: str
    digest: str
    accepted: str


class BrokenBaseline(ValueError):
    """The accepted run is gone, or not what it was when it was accepted."""


def evaluation_folders(folder: Path) -> dict[str, Path]:
    """Evaluation folders by part: the folder itself as part "", or the parts of a run. Raises FileNotFoundError without any."""
    if (folder / EVALUATION).is_file():
        return {"": folder}
    found = {path.parent.name: path.parent for path in sorted(folder.glob(f"*/{EVALUATION}"))}
    if not found:
        raise FileNotFoundError(f"{folder} holds no evaluation ({EVALUATION})")
    return found


def digest(folder: Path) -> str:
    """SHA-256 over evaluations, results, images and references of a folder: changes with any byte that a comparison reads."""
    sha = hashlib.sha256()
    for part, own in evaluation_folders(folder).items():
        files = [own / EVALUATION, *(p for name in CONTENT for p in sorted((own / name).glob("*")) if p.is_file())]
        for path in files:
            sha.update(f"{part}/{path.relative_to(own).as_posix()}\0".encode())
            sha.update(hashlib.sha256(path.read_bytes()).digest())
    return sha.hexdigest()


def read_run(folder: Path) -> RunInfo:
    """`run.json` of a run folder. Raises FileNotFoundError where there is none."""
    return RunInfo.model_validate_json((folder / "run.json").read_text())


def runs_folder(home: Path) -> Path:
    """Where the runs of a data folder lie."""
    return home / "nightly" / "runs"


def history(home: Path) -> list[RunInfo]:
    """All whole runs of a data folder, latest first; empty where there are none. What isn't a run of this version is left out."""
    found = []
    for path in runs_folder(home).glob("[!.]*/run.json"):
        try:
            found.append(read_run(path.parent))
        except (OSError, ValueError) as error:  # pydantic's ValidationError and UnicodeDecodeError are ValueErrors
            log.warning("%s is left out: %s", path, str(error).partition("\n")[0])
    return sorted(found, key=lambda run: (run.started, run.id), reverse=True)


def accept(home: Path, folder: Path) -> Baseline:
    """Make a run the baseline of its suite; the pointer is replaced in one step. Raises FileNotFoundError, or BrokenBaseline where
    the run's files are not those it was made with.
    """
    run = read_run(folder)
    now = digest(folder)
    if now != run.digest:
        raise BrokenBaseline(f"{folder} was altered after the run: its digest is {now[:12]}, run.json says {run.digest[:12]}")
    stamp = datetime.now(UTC).isoformat(timespec="seconds")
    baseline = Baseline(id=run.id, suite=run.suite, folder=str(folder.resolve()), digest=now, accepted=stamp)
    path = _pointer(home, run.suite)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.write_text(baseline.model_dump_json(indent=2) + "\n")
    part.replace(path)
    return baseline


def accepted(home: Path, suite: str) -> Baseline | None:
    """The baseline of a suite; None before the first was accepted. Raises BrokenBaseline where its run is gone or altered."""
    baseline = pointer(home, suite)
    if baseline is None:
        return None
    folder = Path(baseline.folder)
    if not folder.is_dir():
        raise BrokenBaseline(f"the accepted run {folder} is gone; accept another one")
    if digest(folder) != baseline.digest:
        raise BrokenBaseline(f"the accepted run {folder} was altered since it was accepted; accept another one")
    return baseline


def pointer(home: Path, suite: str) -> Baseline | None:
    """The baseline of a suite as it was recorded, unchecked; None before the first was accepted. Raises BrokenBaseline."""
    path = _pointer(home, suite)
    try:
        return Baseline.model_validate_json(path.read_bytes()) if path.is_file() else None
    except ValueError as error:
        raise BrokenBaseline(f"{path} names no run: {str(error).partition(chr(10))[0]}; accept a run again") from None


def _pointer(home: Path, suite: str) -> Path:
    return home / "nightly" / "accepted" / f"{suite}.json"
