"""Compiled kernels belong to the sources that they were made of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderers.transport import kernel_cache

SOURCES = {
    "renderers/transport/kernels.py": "import numba\nfrom renderers.transport import callee\n",
    "renderers/transport/callee.py": "from renderers.scene.model import (\n    A,\n    B,\n)\n",
    "renderers/scene/model.py": "A = B = 1\n",
    "renderers/transport/other.py": "X = 1\n",
}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name, text in SOURCES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def name_of(tree: Path) -> str:
    return kernel_cache.sources_hash(tree / "renderers" / "transport", tree)


@pytest.mark.parametrize("changed", ["renderers/transport/kernels.py", "renderers/transport/callee.py", "renderers/scene/model.py"])
def test_a_change_in_what_a_kernel_uses_starts_anew(tree: Path, changed: str) -> None:
    before = name_of(tree)
    (tree / changed).write_text(SOURCES[changed] + "# changed\n")
    assert name_of(tree) != before
    (tree / changed).write_text(SOURCES[changed])
    assert name_of(tree) == before


def test_a_change_elsewhere_keeps_the_kernels(tree: Path) -> None:
    before = name_of(tree)
    (tree / "renderers/transport/other.py").write_text("X = 2\n")
    assert name_of(tree) == before


def test_numba_stores_kernels_there() -> None:
    from renderers.transport.facing import _count

    assert kernel_cache.sources_hash() in _count.stats.cache_path


FOLDER = "from renderers.transport import kernel_cache; import os; print(os.environ['NUMBA_CACHE_DIR'])"


def folder(**environment: str) -> Path:
    """What a process of this environment uses."""
    inherited = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    done = subprocess.run([sys.executable, "-c", FOLDER], env=inherited | environment, capture_output=True, text=True, check=True)
    return Path(done.stdout.strip())


def test_a_folder_that_the_user_chose_is_kept(tmp_path: Path) -> None:
    assert folder(NUMBA_CACHE_DIR=str(tmp_path)) == tmp_path


def test_a_child_after_an_upgrade_does_not_inherit_its_parents_folder() -> None:
    own = folder()
    assert folder(NUMBA_CACHE_DIR=str(own.parent / "0123456789abcdef")) == own


def test_only_the_folders_used_last_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "_places", lambda: (tmp_path,))
    for age, name in enumerate("abcde"):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    assert kernel_cache._folder("new") == tmp_path / "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "new"]


def test_without_a_writable_place_kernels_last_as_long_as_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(kernel_cache, "_places", lambda: (tmp_path / "file" / "below",))
    made = kernel_cache._folder("new")
    assert made.is_dir()
    assert made.name != "new"
