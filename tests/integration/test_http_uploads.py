"""Uploaded scenes: good ones can be evaluated; hostile ones are refused quickly and cost the service nothing."""

from __future__ import annotations

import json
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from http_service import HEALTHY, FakeQueue, serving
from test_http_api import problem
from work import FEW_CALLS, counted

from renderers import SceneError
from renderers.scene.builder import SceneBuilder
from renderers.scene.gltf.container import pack_glb, split_glb
from renderers.scene.gltf.write import gltf_bytes
from renderers.scene.model import Lambert, PointLight
from service.http.app import create_app
from service.http.inspecting import inspect
from service.http.settings import ServerSettings

pytestmark = pytest.mark.usefixtures("toy_methods")
GLB = {"content-type": "model/gltf-binary"}
MIB = 2**20


def good() -> bytes:
    b = SceneBuilder("good")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert("grey")), "floor")
    b.light(PointLight("lamp", intensity=10.0), (0, 2, 0))
    b.camera((0, 1, 4), (0, 0, 0), 0.8)
    return gltf_bytes(b.build())


GOOD = good()


def parts() -> tuple[dict[str, Any], bytes]:
    text, chunk = split_glb(GOOD, "good")
    assert chunk is not None
    return json.loads(bytes(text)), bytes(chunk)


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def client(home: Path, toy_methods: None) -> Iterator[httpx.Client]:
    limits = {"max_scene_bytes": 24 * MIB, "body_grace_s": 0.5, "requests_per_s": 0.0, "submissions_per_s": 0.0}
    app = create_app(FakeQueue(), ServerSettings(home=home, **limits), machine=lambda: HEALTHY)  # type: ignore[arg-type]
    with serving(app) as address, httpx.Client(base_url=address, timeout=30) as found:
        yield found


def test_a_good_scene_is_stored_once_and_can_be_evaluated(client: httpx.Client, home: Path) -> None:
    first = client.post("/v1/scenes?description=a+floor", content=GOOD, headers=GLB)
    assert first.status_code == 201, first.text
    scene = first.json()
    assert first.headers["location"] == f"/v1/scenes/{scene['name']}"
    assert (scene["kind"], scene["description"]) == ("uploaded", "a floor")
    assert (scene["upload"]["triangles"], scene["upload"]["bytes"]) == (2, len(GOOD))
    assert set(scene["upload"]["needs"]) == {"diffuse", "point_light"}
    again = client.post("/v1/scenes", files={"file": ("good.glb", GOOD, "model/gltf-binary")})
    assert (again.status_code, again.json()["name"]) == (200, scene["name"])
    assert sorted(p.suffix for p in (home / "scenes").iterdir()) == [".glb", ".json"]
    body = {"scenes": [scene["name"]], "methods": [{"name": "flat"}], "size": [8, 6]}
    assert client.post("/v1/evaluations", json=body).json()["cells"][0]["scene"] == scene["name"]
    assert scene in client.get("/v1/scenes").json()["items"]
    picture = client.get(scene["thumbnail"])
    assert picture.headers["content-type"] == "image/png"
    assert picture.content.startswith(b"\x89PNG")
    assert client.delete(f"/v1/scenes/{scene['name']}").status_code == 204
    problem(client.delete(f"/v1/scenes/{scene['name']}"), "not-found")
    problem(client.post("/v1/evaluations", json=body), "unknown-scene")


def test_built_in_scenes_are_listed_with_previews_and_stay(client: httpx.Client) -> None:
    scene = client.get("/v1/scenes/cornell-box").json()
    assert (scene["kind"], scene["name"]) == ("built-in", "cornell-box")
    assert client.get(scene["thumbnail"]).content.startswith(b"\x89PNG")
    problem(client.delete("/v1/scenes/cornell-box"), "not-found")
    problem(client.get("/v1/scenes/nosuch"), "not-found")
    problem(client.get("/v1/scenes/..%2f..%2fetc"), "not-found")


def nodes(count: int) -> bytes:
    root, chunk = parts()
    root["nodes"] += [{} for _ in range(count)]
    return pack_glb(root, chunk)


def lying_accessor() -> bytes:
    root, chunk = parts()
    root["accessors"][0]["count"] = 2**40
    return pack_glb(root, chunk)


def empty_accessor() -> bytes:
    """Accessors without a buffer view stand for zeros: 4 GiB of them for nothing."""
    root, chunk = parts()
    for accessor in root["accessors"]:
        accessor.pop("bufferView")
        accessor["count"] = 10**9
    return pack_glb(root, chunk)


def instances() -> bytes:
    """A mesh of 400 triangles in 15,000 places: a small file of six million triangles."""
    b = SceneBuilder("many")
    grey = b.material(Lambert("grey"))
    for k in range(3):
        b.quad([(-1, k, 1), (1, k, 1), (1, k, -1), (-1, k, -1)], grey, f"q{k}")
    b.light(PointLight("lamp", intensity=10.0), (0, 2, 0))
    b.camera((0, 1, 4), (0, 0, 0), 0.8)
    root, chunk = (bytes(part) for part in split_glb(gltf_bytes(b.build()), "many") if part is not None)
    tree = json.loads(root)
    mesh = next(node["mesh"] for node in tree["nodes"] if "mesh" in node)
    start = len(tree["nodes"])
    primitive = tree["meshes"][mesh]["primitives"][0]
    tree["meshes"][mesh]["primitives"] = [dict(primitive) for _ in range(200)]
    tree["nodes"] += [{"mesh": mesh} for _ in range(15_000)]
    tree["scenes"][0]["nodes"] += list(range(start, start + 15_000))
    return pack_glb(tree, chunk)


def deep() -> bytes:
    text = b'{"asset":{"version":"2.0"},"x":' + b"[" * 200_000 + b"]" * 200_000 + b"}"
    text += b" " * (-len(text) % 4)
    return struct.pack("<III", 0x46546C67, 2, 20 + len(text)) + struct.pack("<II", len(text), 0x4E4F534A) + text


def external(uri: str) -> bytes:
    root, chunk = parts()
    root["buffers"].append({"byteLength": 8, "uri": uri})
    root["bufferViews"][0]["buffer"] = 1
    return pack_glb(root, chunk)


HOSTILE = {
    "empty": lambda: b"",
    "a zip": lambda: b"PK\x03\x04" + b"\0" * 100,
    "cut off": lambda: GOOD[: len(GOOD) // 2],
    "JSON longer than the file": lambda: GOOD[:12] + struct.pack("<I", 2**31) + GOOD[16:],
    "total of 4 GiB": lambda: GOOD[:8] + struct.pack("<I", 2**32 - 1) + GOOD[12:],
    "version 1": lambda: GOOD[:4] + struct.pack("<I", 1) + GOOD[8:],
    "a million nodes": lambda: nodes(10**6),
    "lying accessor": lying_accessor,
    "accessors of nothing": empty_accessor,
    "too many triangles": instances,
    "deep nesting": deep,
    "a file of the server": lambda: external("/etc/passwd"),
    "a file above": lambda: external("../../secret.bin"),
    "an address": lambda: external("http://127.0.0.1:1/x.bin"),
}


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_cheaply(client: httpx.Client, home: Path, name: str) -> None:
    content = HOSTILE[name]()
    client.get("/healthz")
    before = resident()
    answer = client.post("/v1/scenes", content=content, headers=GLB)
    # The client holds the file too, and sends it in pieces; the service itself spools it to disk.
    assert resident() - before < 32 * MIB
    detail = problem(answer, "refused-scene")["detail"]
    assert detail.startswith("scene.glb: ") or "memory" in detail
    assert "\n" not in detail
    assert str(home) not in detail
    assert list((home / "scenes").iterdir()) == []


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_take_little_work(tmp_path: Path, name: str) -> None:
    """What the child that reads an upload does with it: no more calls than the file has bytes, whatever it declares."""
    path = tmp_path / "scene.glb"
    path.write_bytes(HOSTILE[name]())
    with pytest.raises((SceneError, RecursionError)), counted() as work:
        inspect(str(path), ServerSettings().max_scene_nodes, ServerSettings().max_scene_triangles)
    assert work.calls <= FEW_CALLS + path.stat().st_size


def test_the_shared_broken_files(client: httpx.Client, scene_folder: Path) -> None:
    files = sorted((scene_folder / "broken").glob("*.glb"))
    assert files
    for path in files:
        answer = client.post("/v1/scenes", content=path.read_bytes(), headers=GLB)
        assert answer.status_code in (201, 422), path.name
        if answer.status_code == 422:
            problem(answer, "refused-scene")


def test_wrong_types_and_sizes(client: httpx.Client) -> None:
    problem(client.post("/v1/scenes", content=GOOD, headers={"content-type": "text/xml"}), "unsupported-media-type")
    problem(client.post("/v1/scenes", content=GOOD), "unsupported-media-type")
    problem(client.post("/v1/scenes", files={"other": ("x.glb", GOOD)}), "refused-scene")
    problem(client.post("/v1/scenes", content=b"glTF" + bytes(25 * MIB), headers=GLB), "payload-too-large")
    chunks = (b"glTF" + struct.pack("<IIII", 2, 24 * MIB, 100, 0x4E4F534A) if k == 0 else bytes(MIB) for k in range(30))
    problem(client.post("/v1/scenes", content=chunks, headers=GLB), "payload-too-large")
    problem(
        client.post("/v1/evaluations", content=b" " * 2 * MIB, headers={"content-type": "application/json"}), "payload-too-large"
    )


def test_a_trickling_body_is_cut_off(client: httpx.Client) -> None:
    host, port = client.base_url.host, client.base_url.port
    assert port is not None
    for path, kind in (("/v1/scenes", "model/gltf-binary"), ("/v1/evaluations", "application/json")):
        with socket.create_connection((host, port), timeout=120) as connection:
            head = f"POST {path} HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Type: {kind}\r\nContent-Length: 100000\r\n\r\n"
            connection.sendall(head.encode() + b"g")
            answer = b""
            while piece := connection.recv(65536):
                answer += piece
            assert b" 408 " in answer.split(b"\r\n", 1)[0]
            assert b"/problems/request-timeout" in answer
            assert b"within 0.5 s, then" in answer
