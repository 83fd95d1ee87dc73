"""The artefact store: content under its hash, keys bound once, damaged files. In a folder and in another file system."""

from __future__ import annotations

import hashlib
import threading
import uuid
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs import points
from jobs.artifacts import Artifacts, Bound, is_hash
from jobs.errors import StoreError


@pytest.fixture(params=["folder", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Artifacts:
    return Artifacts(str(tmp_path / "store") if request.param == "folder" else f"memory://{uuid.uuid4().hex}")


def test_bytes_come_back_under_their_hash(store: Artifacts, tmp_path: Path) -> None:
    name = store.put(b"light")
    assert name == hashlib.sha256(b"light").hexdigest()
    assert store.put(b"light") == name
    assert store.get(name) == b"light"
    assert store.has(name)
    found = store.open(name)
    assert found is not None
    with found[0] as stream:
        assert (stream.read(2), found[1]) == (b"li", 5)
    store.get_file(name, tmp_path / "deep" / "copy")
    assert (tmp_path / "deep" / "copy").read_bytes() == b"light"
    assert [(size, Path(path).name) for path, size, _ in store.entries("sha256")] == [(5, name)]
    store.remove(next(store.entries("sha256"))[0])
    assert not store.has(name)
    with pytest.raises(StoreError, match="has no artefact"):
        store.get(name)


@pytest.mark.parametrize("name", ["", "../../etc/passwd", "A" * 64, "0" * 63, "0" * 64])
def test_names_that_are_no_artefacts(store: Artifacts, name: str) -> None:
    assert store.open(name) is None
    assert not store.has(name)


def test_the_first_binding_stays_and_another_answer_is_a_clash(store: Artifacts) -> None:
    assert store.lookup("k") is None
    assert store.bind("k", "a", {"n": 1}) == Bound("a", {"n": 1}, False)
    assert store.bind("k", "a", {"n": 2}) == Bound("a", {"n": 1}, False)
    assert store.clashes() == []
    assert store.bind("k", "b", {"n": 3}) == Bound("a", {"n": 1}, True)
    assert store.lookup("k") == Bound("a", {"n": 1})
    assert [(c["key"], c["first"], c["identity"]) for c in store.clashes()] == [("k", "a", "b")]
    store.point("p", {"n": 1})
    store.point("p", {"n": 2})
    assert store.lookup("p") == Bound("", {"n": 2})


def test_many_binders_of_one_key_see_one_answer(tmp_path: Path) -> None:
    store, seen = Artifacts(str(tmp_path)), list[str]()
    threads = [threading.Thread(target=lambda k=k: seen.append(store.bind("k", str(k), {}).identity)) for k in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(seen)) == 1
    assert len(store.clashes()) == 15


def test_a_damaged_artefact_is_found_out_and_can_be_made_again(tmp_path: Path) -> None:
    store = Artifacts(str(tmp_path))
    name = store.put(b"light")
    (tmp_path / "sha256" / name[:2] / name).write_bytes(b"night")
    with pytest.raises(StoreError, match="damaged"):
        store.get(name)
    assert store.put(b"light") == name
    assert store.get(name) == b"light"


@pytest.mark.parametrize("label", ["artifact before write", "artifact half written", "artifact before bind"])
def test_a_fault_leaves_nothing_behind(tmp_path: Path, label: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(reached: str) -> None:
        if reached == label:
            raise OSError(28, "No space left on device")

    store = Artifacts(str(tmp_path / "store"))
    monkeypatch.setattr(points, "hook", fail)
    work = (lambda: store.put(b"light")) if label != "artifact before bind" else (lambda: store.bind("k", "a", {}))
    with pytest.raises(StoreError, match="No space left on device"):
        work()
    monkeypatch.setattr(points, "hook", None)
    assert not any((tmp_path / "store").rglob(".*"))
    assert store.lookup("k") is None


@given(st.text(max_size=70))
def test_only_hashes_are_hashes(text: str) -> None:
    assert is_hash(text) == (len(text) == 64 and all(c in "0123456789abcdef" for c in text))
