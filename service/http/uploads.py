"""Uploaded scenes: .glb files, kept under the hash of their bytes once a limited child process has read them."""

from __future__ import annotations

import hashlib
import os
import struct
import tempfile
import threading
from collections.abc import AsyncIterator
from pathlib import Path

from anyio.to_thread import run_sync
from pydantic import BaseModel

from jobs.files import write_model
from jobs.scenes import UPLOAD, upload_file
from service.http.limited import Refused, run
from service.http.problems import Problem
from service.http.settings import ServerSettings

HEADER = 20  # bytes: magic, version, total length; length and kind of the first chunk
MAX_JSON_BYTES = 16 * 2**20
AT_ONCE = 2


class UploadedScene(BaseModel):
    """What is told of an uploaded scene. `name` is what an evaluation request calls it by."""

    name: str
    kind: str = "uploaded"
    description: str
    bytes: int
    triangles: int
    needs: list[str]
    notes: list[str]
    hash: str


class Uploads:
    """The folder of uploaded scenes: NAME.glb and what was found in it, NAME.json."""

    def __init__(self, settings: ServerSettings) -> None:
        self.settings = settings
        self._slots = threading.BoundedSemaphore(AT_ONCE)

    def all(self) -> list[UploadedScene]:
        """Every uploaded scene, by name."""
        return [UploadedScene.model_validate_json(p.read_text()) for p in sorted(self.settings.scenes.glob(f"{UPLOAD}*.json"))]

    def find(self, name: str) -> UploadedScene | None:
        """One uploaded scene, None where there is none of that name."""
        path = upload_file(name, self.settings.home)
        return UploadedScene.model_validate_json(path.with_suffix(".json").read_text()) if path else None

    def remove(self, name: str) -> bool:
        """Remove an uploaded scene; whether there was one. Evaluations that were made of it keep their results."""
        path = upload_file(name, self.settings.home)
        if path is None:
            return False
        path.unlink()
        path.with_suffix(".json").unlink()
        return True

    async def receive(self, chunks: AsyncIterator[bytes], description: str) -> tuple[UploadedScene, bool]:
        """Take a file in; returns its scene and whether it is new. Raises Problem where it is refused; nothing is kept then."""
        self.settings.scenes.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".incoming-", suffix=".glb", dir=self.settings.scenes)
        path = Path(temporary)
        try:
            digest, size = await _spool(handle, chunks, self.settings.max_scene_bytes)
            return await run_sync(self._admit, path, f"{UPLOAD}{digest[:32]}", size, description)
        finally:
            path.unlink(missing_ok=True)

    def _admit(self, path: Path, name: str, size: int, description: str) -> tuple[UploadedScene, bool]:
        known = self.find(name)
        if known is not None:
            return known, False
        limits = [str(self.settings.max_scene_nodes), str(self.settings.max_scene_triangles)]
        if not self._slots.acquire(timeout=self.settings.scene_seconds):
            raise Problem("unavailable", "other scenes are being read", {"retry-after": "5"})
        try:
            arguments = [*limits, str(path), "scene.glb"]
            found = run("service.http.inspecting", arguments, self.settings.scene_seconds, self.settings.scene_memory_bytes)
        except Refused as error:
            raise Problem("refused-scene", str(error)) from None
        finally:
            self._slots.release()
        scene = UploadedScene(name=name, description=description, bytes=size, **found)
        write_model(self.settings.scenes / f"{name}.json", scene)
        os.replace(path, self.settings.scenes / f"{name}.glb")  # last: a scene is there once its file is
        return scene, True


async def _spool(handle: int, chunks: AsyncIterator[bytes], limit: int) -> tuple[str, int]:
    """Write the chunks to an open file; returns their SHA-256 and size. The header is judged as soon as it is there."""
    digest, size, head = hashlib.sha256(), 0, b""
    with open(handle, "wb") as file:
        async for chunk in chunks:
            size += len(chunk)
            if size > limit:
                raise Problem("payload-too-large", f"a scene may have {limit} bytes", {"connection": "close"})
            if len(head) < HEADER:
                head += chunk[: HEADER - len(head)]
                check_header(head, limit)
            digest.update(chunk)
            await run_sync(file.write, chunk)
    if len(head) < HEADER:
        raise Problem("refused-scene", f"scene.glb: {size} bytes are too few for a GLB file")
    declared = struct.unpack_from("<I", head, 8)[0]
    if declared != size:
        raise Problem("refused-scene", f"scene.glb: header: says {declared} bytes, the file has {size}")
    return digest.hexdigest(), size


def check_header(head: bytes, limit: int) -> None:
    """Raises Problem as soon as the first bytes can't be those of an acceptable GLB file."""
    if not head.startswith(b"glTF"[: len(head)]):
        raise Problem("refused-scene", "scene.glb: header: not a GLB file")
    if len(head) < HEADER:
        return
    version, total, length, kind = struct.unpack_from("<IIII", head, 4)
    if version != 2:
        raise Problem("refused-scene", f"scene.glb: header: GLB version {version} is not supported, only 2")
    if kind != 0x4E4F534A:
        raise Problem("refused-scene", "scene.glb: chunk 0: must be JSON")
    if total > limit or length > min(total, MAX_JSON_BYTES):
        raise Problem(
            "refused-scene", f"scene.glb: header: {total} bytes with {length} of JSON; the limits are {limit} and {MAX_JSON_BYTES}"
        )
