"""What killed processes leave is removed once it is old and nobody is at it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from jobs.artifacts import Artifacts
from jobs.leftovers import clean_up_machine, work_folder
from jobs.machine import only_one

DAY_S = 86_400


@pytest.fixture(autouse=True)
def _own_folder_for_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def test_folders_of_dead_processes_go_and_those_of_live_ones_stay(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    left = tmp_path / f"luxmeter-{dead.pid}-abc_1"
    (left / "images").mkdir(parents=True)
    others = [tmp_path / "luxmeter-x", tmp_path / f"other-{dead.pid}-abc"]
    for path in others:
        path.mkdir()
    with work_folder() as ours:
        assert clean_up_machine(tmp_path / "home") == []  # it may belong to a process that has just begun elsewhere
        assert clean_up_machine(tmp_path / "home", time.time() + 3 * DAY_S) == [left]
        assert ours.is_dir()
    assert not left.exists()
    assert not ours.exists()
    assert all(path.is_dir() for path in others)


def test_unfinished_files_of_the_data_folder(tmp_path: Path) -> None:
    kept, left = tmp_path / "references" / "a.npz", tmp_path / "references" / ".a.xyz.npz"
    kept.parent.mkdir()
    for path in (kept, left):
        path.write_bytes(b"x")
    assert clean_up_machine(tmp_path) == []
    assert clean_up_machine(tmp_path, time.time() + 3 * DAY_S) == [left]
    assert list(kept.parent.iterdir()) == [kept]


def test_databases_of_commands_go_when_nobody_repeats_the_command(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    for name in ("used", "left", "young"):
        for suffix in (".sqlite", ".sqlite-wal"):
            (runs / f"{name}{suffix}").write_bytes(b"x")
            if name != "young":
                os.utime(runs / f"{name}{suffix}", (1, 1))
    with only_one(runs / "used.lock"):
        assert clean_up_machine(tmp_path) == [runs / "left.sqlite"]
    assert sorted(path.name for path in runs.glob("*.sqlite*")) == [
        "used.sqlite", "used.sqlite-wal", "young.sqlite", "young.sqlite-wal",
    ]  # fmt: skip


def test_a_store_names_what_was_never_finished(tmp_path: Path) -> None:
    store = Artifacts(str(tmp_path / "store"))
    assert list(store.leftovers()) == []
    name = store.put(b"whole")
    part = tmp_path / "store" / "sha256" / name[:2] / ".k2j.part"
    part.write_bytes(b"ha")
    assert [(Path(path), written) for path, written in store.leftovers()] == [(part, part.stat().st_mtime)]
