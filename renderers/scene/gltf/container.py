"""Files to (JSON, buffers) and back: GLB chunks, data URIs, files beside a .gltf. Nothing is allocated on a header's word alone.

Limits: `files.MAX_FILE_BYTES` for one file, MAX_JSON_BYTES for the JSON text. URIs: `data:`, or, for .gltf, the plain name of a
file in the same folder.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from renderers.scene.files import read_limited, sibling
from renderers.scene.gltf.element import Element, quoted
from renderers.scene.model import SceneError

MAX_JSON_BYTES = 16 * 2**20
GLB_MAGIC, JSON_CHUNK, BIN_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, eq=False)
class Document:
    """A parsed file. `folder` is where a .gltf may find its buffers and images; None for .glb, which must hold all."""

    root: Element
    chunk: memoryview | None
    folder: Path | None

    def buffers(self) -> list[memoryview]:
        """Content of every buffer, exactly as long as its byteLength says."""
        return [self._buffer(index, item) for index, item in enumerate(self.root.objects("buffers"))]

    def _buffer(self, index: int, item: Element) -> memoryview:
        length = item.integer("byteLength", low=1)
        if item.has("uri"):
            data = memoryview(self.uri(item))
        elif index == 0 and self.chunk is not None:
            data = self.chunk
        else:
            raise item.error("has neither a URI nor a binary chunk")
        if len(data) < length:
            raise item.error(f"byteLength {length} runs past the {len(data)} bytes there are")
        return data[:length]

    def uri(self, item: Element) -> bytes:
        """What the element's `uri` stands for. Raises SceneError for anything but data and files of the same folder."""
        uri = item.text("uri")
        if uri.startswith("data:"):
            head, comma, body = uri.partition(",")
            if not comma or not head.endswith(";base64"):
                raise item.error("data URI is not base64")
            try:
                return base64.b64decode(body, validate=True)
            except binascii.Error as error:
                raise item.error(f"data URI is not base64 ({error})") from None
        path = None if self.folder is None else sibling(self.folder, unquote(uri))
        if path is None:
            where = "not allowed in .glb" if self.folder is None else "no plain name of a file beside the scene"
            raise item.error(f"external URI {quoted(uri)}: {where}")
        return read_limited(path)


def open_document(path: Path) -> Document:
    """Parse a .glb or .gltf file down to its JSON root. Raises SceneError."""
    data = read_limited(path)
    if path.suffix.lower() == ".glb":
        text, chunk = split_glb(data, str(path))
        return Document(parse_json(text, str(path)), chunk, None)
    return Document(parse_json(memoryview(data), str(path)), None, path.parent)


def split_glb(data: bytes, file: str) -> tuple[memoryview, memoryview | None]:
    """The JSON chunk and the binary chunk (None when there is none) of a GLB container."""
    if len(data) < 12 or struct.unpack_from("<I", data)[0] != GLB_MAGIC:
        raise SceneError(f"{file}: header: not a GLB file")
    version, total = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise SceneError(f"{file}: header: GLB version {version} is not supported, only 2")
    if total != len(data):
        raise SceneError(f"{file}: header: says {total} bytes, the file has {len(data)}")
    chunks: dict[int, memoryview] = {}
    view, at = memoryview(data), 12
    while at < total:
        if at + 8 > total:
            raise SceneError(f"{file}: chunk {len(chunks)}: header is cut off")
        length, kind = struct.unpack_from("<II", data, at)
        if at + 8 + length > total:
            raise SceneError(f"{file}: chunk {len(chunks)}: says {length} bytes, {total - at - 8} are left")
        if at == 12 and kind != JSON_CHUNK:
            raise SceneError(f"{file}: chunk 0: must be JSON")
        chunks.setdefault(kind, view[at + 8 : at + 8 + length])
        at += 8 + length
    if JSON_CHUNK not in chunks:
        raise SceneError(f"{file}: header: no JSON chunk")
    return chunks[JSON_CHUNK], chunks.get(BIN_CHUNK)


def parse_json(text: memoryview, file: str) -> Element:
    """The root object of strict JSON: no NaN, no infinity, no endless nesting."""
    if len(text) > MAX_JSON_BYTES:
        raise SceneError(f"{file}: JSON: {len(text)} bytes, more than the limit of {MAX_JSON_BYTES}")

    def refuse(word: str) -> None:
        raise SceneError(f"{file}: JSON: {word} is not JSON")

    try:
        root = json.loads(bytes(text).decode("utf-8"), parse_constant=refuse)
    except RecursionError:
        raise SceneError(f"{file}: JSON: nested too deeply") from None
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(f"{file}: JSON: {str(error).splitlines()[0]}") from None
    if not isinstance(root, dict):
        raise SceneError(f"{file}: JSON: must be an object")
    return Element(file, "glTF", root)


def pack_glb(root: dict[str, Any], binary: bytes) -> bytes:
    """A GLB file of one JSON and one binary chunk, padded to 4 bytes each."""
    text = json.dumps(root, separators=(",", ":"), allow_nan=False).encode()
    chunks = [(JSON_CHUNK, text + b" " * (-len(text) % 4))]
    if binary:
        chunks.append((BIN_CHUNK, binary + b"\0" * (-len(binary) % 4)))
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return struct.pack("<III", GLB_MAGIC, 2, 12 + len(body)) + body
