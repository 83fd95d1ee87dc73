"""Data folder, whole files, hashes of code and settings."""

from __future__ import annotations

from pathlib import Path

import pytest

from jobs.code import code_hash, versions
from jobs.files import whole, write_text
from jobs.settings import settings_hash
from jobs.store import Store


def test_first_exposure_stays(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.exposure("abc") is None
    assert store.keep_exposure("abc", 0.25) == 0.25
    assert store.keep_exposure("abc", 4.0) == 0.25
    assert Store(tmp_path).exposure("abc") == 0.25


def test_home_is_read_from_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "data"))
    Store().check_writable()
    assert (tmp_path / "data").is_dir()
    monkeypatch.delenv("LUXMETER_HOME")
    monkeypatch.setenv("HOME", "/home/someone")
    assert Store().home == Path("/home/someone/.local/share/luxmeter")


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "a.txt"

    def fail() -> None:
        with whole(path) as temporary:
            temporary.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list((tmp_path / "deep").iterdir()) == []
    write_text(path, "all")
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["a.txt"]
    assert path.read_text() == "all"


def test_settings_hash_ignores_the_order_of_keys() -> None:
    assert settings_hash({"a": 1, "b": [2, 3]}) == settings_hash({"b": [2, 3], "a": 1})
    assert settings_hash({"a": 1}) != settings_hash({"a": 2})


def test_code_hash_and_versions() -> None:
    assert len(code_hash()) == 64
    assert {"python", "numpy", "mitsuba"} <= set(versions())
