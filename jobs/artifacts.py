"""The artefact store: files under the SHA-256 of their bytes, and keys that say which of them answer a piece of work.

A folder by default; any fsspec URL (LUXMETER_STORE), so that several machines share one. Layout:

  sha256/ab/abcd…      the bytes whose hash is abcd…
  keys/ab/abcd….json   the first binding of a key (abcd… is the key's hash): what was made, and its identity
  clashes/abcd….*.json later bindings of that key with other identities: determinism failures

In a folder each file is written under a temporary name, flushed to disk, and renamed, or linked where it must not replace another.
Object stores put whole objects; a key is created with mode `xb` where the store has it, and otherwise after asking whether it
exists: two machines that bind one key in the same instant may then both believe to be first, which loses nothing, since each
artefact lies under its own hash and equal work makes equal artefacts.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from jobs.errors import StoreError
from jobs.points import reach

PART = ".part"


@dataclass(frozen=True)
class Bound:
    """What a key is bound to: `identity` decides whether two answers are equal, `value` where they lie. clash: ours differs."""

    identity: str
    value: dict[str, Any]
    clash: bool = False


class Artifacts:
    """Content-addressed files. `url`: a folder, or anything fsspec opens. Raises StoreError where the store can't be used."""

    def __init__(self, url: str) -> None:
        import fsspec

        self.url = url
        self._files, path = fsspec.core.url_to_fs(url, auto_mkdir=True)
        self._root = str(path).rstrip("/")
        self.local = "file" in _protocols(self._files)

    def put(self, data: bytes) -> str:
        """Store bytes; returns their hash. Bytes that are there already aren't written again, but count as used now."""
        name = hashlib.sha256(data).hexdigest()
        with _readable_errors(self.url):
            path = self._path("sha256", name)
            reach("artifact before write")
            if self.local and _touch(path):
                return name
            if self.local or not self._files.exists(path):
                self._write(path, data)
            reach("artifact after write")
        return name

    def put_file(self, path: Path) -> str:
        """Store a file's bytes; returns their hash."""
        return self.put(path.read_bytes())

    def open(self, name: str) -> tuple[BinaryIO, int] | None:
        """An open binary file and its size in bytes; None where there is no artefact of this hash."""
        if not is_hash(name):
            return None
        with _readable_errors(self.url):
            path = self._path("sha256", name)
            if not self._files.exists(path):
                return None
            return self._files.open(path, "rb"), int(self._files.size(path))

    def get(self, name: str) -> bytes:
        """The bytes of an artefact. Raises StoreError where it is missing or damaged."""
        found = self.open(name)
        if found is None:
            raise StoreError(f"{self.url} has no artefact {name}")
        with found[0] as stream:
            data = stream.read()
        if hashlib.sha256(data).hexdigest() != name:
            self.remove(self._path("sha256", name))  # whoever makes it again can store it
            raise StoreError(f"artefact {name} in {self.url} was damaged and is removed")
        return data

    def get_file(self, name: str, path: Path) -> None:
        """Write an artefact's bytes to a file, whole."""
        from jobs.files import whole

        data = self.get(name)
        with whole(path) as temporary:
            temporary.write_bytes(data)

    def bind(self, key: str, identity: str, value: dict[str, Any]) -> Bound:
        """Bind a key unless it is bound; returns the first binding, and whether ours has another identity, which is recorded."""
        name = hashlib.sha256(key.encode()).hexdigest()
        entry = {"key": key, "identity": identity, "value": value}
        with _readable_errors(self.url):
            reach("artifact before bind")
            first = self._create(self._path("keys", name) + ".json", json.dumps(entry).encode())
            reach("artifact after bind")
            clash = first["identity"] != identity
            if clash:
                other = hashlib.sha256(identity.encode()).hexdigest()
                path = f"{self._root}/clashes/{name}.{other[:16]}.json"
                self._create(path, json.dumps(entry | {"first": first["identity"]}).encode())
        return Bound(first["identity"], first["value"], clash)

    def point(self, key: str, value: dict[str, Any]) -> None:
        """Have a key point to `value`, whatever it pointed to: the last writer wins."""
        name = hashlib.sha256(key.encode()).hexdigest()
        with _readable_errors(self.url):
            self._write(self._path("keys", name) + ".json", json.dumps({"key": key, "identity": "", "value": value}).encode())

    def has(self, name: str) -> bool:
        """Whether there is an artefact of this hash."""
        with _readable_errors(self.url):
            return is_hash(name) and bool(self._files.exists(self._path("sha256", name)))

    def lookup(self, key: str) -> Bound | None:
        """What a key is bound to, None where it isn't; a damaged entry counts as none."""
        path = self._path("keys", hashlib.sha256(key.encode()).hexdigest()) + ".json"
        with _readable_errors(self.url):
            try:
                entry = json.loads(self._files.cat_file(path))
            except (FileNotFoundError, json.JSONDecodeError):
                return None
        return Bound(entry["identity"], entry["value"])

    def clashed(self, key: str) -> bool:
        """Whether a determinism failure of this key was ever met."""
        return any(Path(path).name.startswith(hashlib.sha256(key.encode()).hexdigest()) for path in self._clash_files())

    def clashes(self) -> list[dict[str, Any]]:
        """Every determinism failure met: key, the identity that came first, and the other one."""
        with _readable_errors(self.url):
            return [json.loads(self._files.cat_file(path)) for path in self._clash_files()]

    def _clash_files(self) -> list[str]:
        with _readable_errors(self.url):
            folder = f"{self._root}/clashes"
            if not self._files.isdir(folder):
                return []
            return sorted(path for path in self._files.ls(folder, detail=False) if path.endswith(".json"))

    def entries(self, kind: str) -> Iterator[tuple[str, int, float]]:
        """Every file of `sha256` or `keys`: path in the store, bytes, and when it was written or used last (0 where unknown)."""
        root = f"{self._root}/{kind}"
        with _readable_errors(self.url):
            if not self._files.isdir(root):
                return
            for path, info in self._files.find(root, detail=True).items():
                if not Path(path).name.startswith("."):
                    yield path, int(info["size"]), _modified(info)

    def leftovers(self) -> Iterator[tuple[str, float]]:
        """Files that were being written: path and when it was written last. Those of a process that was killed stay."""
        if self.local:
            for path in Path(self._root).glob(f"*/**/.*{PART}"):
                with contextlib.suppress(FileNotFoundError):
                    yield str(path), path.stat().st_mtime

    def read(self, path: str) -> bytes:
        """Bytes of a file that `entries` named."""
        with _readable_errors(self.url):
            return bytes(self._files.cat_file(path))

    def remove(self, path: str) -> None:
        """Remove a file that `entries` or `leftovers` named; one that is gone already is fine."""
        with _readable_errors(self.url), contextlib.suppress(FileNotFoundError):
            self._files.rm_file(path)

    def check_writable(self) -> None:
        """Raises StoreError where nothing can be written."""
        with _readable_errors(self.url):
            path = f"{self._root}/.probe-{os.getpid()}"
            self._write(path, b"luxmeter")
            self._files.rm_file(path)

    def _path(self, kind: str, name: str) -> str:
        return f"{self._root}/{kind}/{name[:2]}/{name}"

    def _write(self, path: str, data: bytes) -> None:
        if not self.local:
            self._files.pipe_file(path, data)
            return
        with _temporary(Path(path), data) as temporary:
            os.replace(temporary, path)

    def _create(self, path: str, data: bytes) -> dict[str, Any]:
        """Create a small file unless there is a sound one; returns what it holds in the end."""
        if self.local and not _touch(path):
            with contextlib.suppress(FileExistsError), _temporary(Path(path), data) as temporary:
                os.link(temporary, path)
        elif not self.local and not self._files.exists(path):
            with contextlib.suppress(FileExistsError):
                self._create_remote(path, data)
        return dict(json.loads(self._files.cat_file(path)))

    def _create_remote(self, path: str, data: bytes) -> None:
        try:
            with self._files.open(path, "xb") as stream:
                stream.write(data)
        except (NotImplementedError, ValueError):  # the store has no exclusive creation
            self._files.pipe_file(path, data)


def is_hash(name: str) -> bool:
    """Whether `name` is a SHA-256 in lower-case hexadecimal."""
    return len(name) == 64 and set(name) <= set("0123456789abcdef")


@contextlib.contextmanager
def _temporary(path: Path, data: bytes) -> Iterator[Path]:
    """A file of these bytes beside `path`, flushed to disk; gone when the block ends."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=PART)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            reach("artifact half written")
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(0o644)
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _readable_errors(url: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(f"can't use the artefact store {url}: {error.strerror or error}") from error


def _touch(path: str) -> bool:
    """Whether the file is there; its time becomes now."""
    try:
        os.utime(path)
    except FileNotFoundError:
        return False
    return True


def _modified(info: dict[str, Any]) -> float:
    found = info.get("mtime") or info.get("LastModified") or info.get("updated") or 0.0
    return float(found.timestamp() if hasattr(found, "timestamp") else found)


def _protocols(files: Any) -> tuple[str, ...]:
    return (files.protocol,) if isinstance(files.protocol, str) else tuple(files.protocol)
