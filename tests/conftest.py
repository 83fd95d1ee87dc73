"""What all tests share."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import browsers
import databases
import pytest

ROOT = Path(__file__).parents[1]
PLUGINS = ROOT / "tests" / "plugins"


def pytest_collection_finish() -> None:
    """What collection made stays to the end: garbage collections need not search 2,700 tests and the libraries again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _own_data_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test reads or writes the user's data folder; the tests of one session share one, and with it the cached references."""
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path_factory.getbasetemp() / "home"))


@pytest.fixture
def software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """Methods take the device for a software rasteriser, and ask no driver."""
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe (LLVM 15.0.6, 256 bits)")


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


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[str]:
    """A PostgreSQL server of this test session."""
    server = databases.postgres()
    try:
        url = server.__enter__()
    except databases.NoPostgres as reason:
        pytest.skip(str(reason))
    databases.create_tables(f"{url}/postgres")
    try:
        yield url
    finally:
        server.__exit__(None, None, None)


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty database, of each kind the queue runs on."""
    if request.param == "sqlite":
        return databases.new_file(request.getfixturevalue("sqlite_template"), tmp_path / "queue.sqlite")
    return databases.new_database(request.getfixturevalue("postgres_server"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium. One a module: a running playwright keeps others from running an event loop in this thread."""
    with browsers.chromium() as found:
        yield found


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An SQLite file whose tables exist: creating them takes longer than most tests."""
    return databases.template(tmp_path_factory.mktemp("template") / "queue.sqlite")
