"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PLUGINS = ROOT / "tests" / "plugins"


@pytest.fixture(autouse=True)
def _own_data_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test reads or writes the user's data folder; the tests of one session share one, and with it the cached references."""
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path_factory.getbasetemp() / "home"))


@pytest.fixture
def toy_methods(monkeypatch: pytest.MonkeyPatch) -> None:
    """The methods `flat` and `budget` are registered, in child processes too."""
    path = [str(ROOT), str(PLUGINS), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path))
    monkeypatch.setenv("LUXMETER_PLUGINS", "toy_methods")


@pytest.fixture
def scene_folder() -> Path:
    """The folder of real scenes that LUXMETER_SCENES names."""
    folder = Path(os.environ.get("LUXMETER_SCENES", ""))
    if not os.environ.get("LUXMETER_SCENES") or not folder.is_dir():
        pytest.skip("scene folder not present: LUXMETER_SCENES names none")
    return folder
