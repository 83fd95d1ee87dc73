"""Output folders appear whole or not at all, and nothing of the user's is overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from jobs.errors import RequestError
from service.output import staged


def test_the_folder_appears_when_all_is_done(tmp_path: Path) -> None:
    with staged(tmp_path / "a" / "out", force=False) as folder:
        (folder / "result.json").write_text("{}")
        assert not (tmp_path / "a" / "out").exists()
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["out"]
    assert (tmp_path / "a" / "out" / "result.json").is_file()


def fail_in(out: Path, error: BaseException) -> None:
    with staged(out, force=False) as folder:
        (folder / "half").write_text("")
        raise error


@pytest.mark.parametrize("error", [ValueError(), KeyboardInterrupt()])
def test_a_failure_leaves_nothing(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)):
        fail_in(tmp_path / "out", error)
    assert list(tmp_path.iterdir()) == []


def test_only_earlier_outputs_are_replaced_and_only_when_asked(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with staged(out, force=False) as folder:
        (folder / "result.json").write_text("1")
    with pytest.raises(RequestError, match="is not empty; --force replaces"), staged(out, force=False):
        pass
    with staged(out, force=True) as folder:
        (folder / "result.json").write_text("2")
    assert (out / "result.json").read_text() == "2"
    (out / "result.json").rename(out / "thesis.tex")
    with pytest.raises(RequestError, match="luxmeter did not write"), staged(out, force=True):
        pass
    assert (out / "thesis.tex").read_text() == "2"


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(RequestError, match="is a file"), staged(tmp_path / "out", force=True):
        pass
