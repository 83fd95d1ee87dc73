"""glTF 2.0 out: a Scene to one self-contained .glb that reads back as the same Scene (equal hash, names and extras).

What core glTF and its extensions can't say goes into extras.luxmeter beside a glTF approximation (docs/scenes.md).
"""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.scene.gltf.container import pack_glb
from renderers.scene.gltf.encode import Json, camera_json, face_on_area, light_json, material_json, named
from renderers.scene.gltf.extras import put_extras
from renderers.scene.model import BLACK, WHITE, Channel, DiscLight, Mesh, Node, Scene, SceneError, SphereLight, Texture
from renderers.scene.world import rest_bounds

COMPONENTS = {np.dtype("<f4"): 5126, np.dtype("<u2"): 5123, np.dtype("<u4"): 5125}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}


class Binary:
    """The binary chunk in the making, with its buffer views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[Json] = []
        self.accessors: list[Json] = []

    def view(self, data: bytes) -> int:
        """Add bytes, aligned to 8, as a buffer view."""
        self.data += b"\0" * (-len(self.data) % 8)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.views) - 1

    def accessor(self, values: NDArray[Any], *, bounds: bool = False) -> int:
        """Add an array (N,) or (N, width) as an accessor, with min and max if `bounds`."""
        rows = values.reshape(len(values), -1)
        item: Json = {
            "bufferView": self.view(rows.tobytes()),
            "componentType": COMPONENTS[rows.dtype],
            "count": len(rows),
            "type": TYPES[rows.shape[1]],
        }
        if bounds:
            item |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(item)
        return len(self.accessors) - 1

    def raw(self, values: NDArray[Any], kind: str) -> Json:
        """Add an array as bare little-endian numbers, for extras.luxmeter."""
        data = values.astype(np.dtype(kind).newbyteorder("<")).tobytes()
        return {"bufferView": self.view(data), "type": kind, "shape": list(values.shape)}


def write_gltf(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write `scene` to a .glb file. Raises SceneError for what glTF can't hold (a base colour beyond 1, a spot wider than π/2)."""
    if Path(path).suffix.lower() != ".glb":
        raise SceneError(f"{os.fspath(path)}: file: only .glb is written")
    Path(path).write_bytes(gltf_bytes(scene))


def gltf_bytes(scene: Scene) -> bytes:
    """`scene` as the bytes of a .glb file; equal scenes give equal bytes."""
    binary = Binary()
    own: Json = {"name": scene.name, "fps": scene.fps}
    meshes, places, order = _meshes(scene, binary)
    root: Json = {
        "asset": {"version": "2.0", "generator": "luxmeter"},
        "scene": 0,
        "scenes": [],
        "nodes": _nodes(scene, places),
        "meshes": meshes,
        "materials": [material_json(m) for m in scene.materials],
        "cameras": [camera_json(c, rest_bounds(scene)[1]) for c in scene.cameras],
    }
    root |= _textures(scene.textures, binary)
    if scene.channels:
        root["animations"] = [_animation(scene, binary)]
    if scene.lights:
        root["extensions"] = {"KHR_lights_punctual": {"lights": [light_json(light) for light in scene.lights]}}
    own |= {"meshes": order, **_own_scene(scene, binary)}
    if "copyright" in scene.parameters:
        root["asset"]["copyright"] = str(scene.parameters["copyright"])
    if "asset" in scene.parameters:
        root["asset"]["extras"] = scene.parameters["asset"]
    roots = [i for i, node in enumerate(scene.nodes) if node.parent is None]
    root["scenes"] = [put_extras({"name": scene.name, **({"nodes": roots} if roots else {})}, "", own)]
    root |= {"accessors": binary.accessors, "bufferViews": binary.views}
    if binary.data:
        root["buffers"] = [{"byteLength": len(binary.data)}]
    used = _extensions_used(root)
    root |= {"extensionsUsed": used} if used else {}
    # glTF forbids empty arrays
    return pack_glb({k: v for k, v in root.items() if v != []}, bytes(binary.data))


def _own_scene(scene: Scene, binary: Binary) -> Json:
    own: Json = {}
    if scene.exposure is not None:
        own["exposure"] = scene.exposure
    if scene.environment is not None:
        env = scene.environment
        own["environment"] = {"radiance": env.radiance, "rotation": env.rotation}
        if env.image is not None:
            own["environment"]["image"] = binary.raw(env.image, "float32")
    if scene.notes:
        own["notes"] = list(scene.notes)
    parameters = {k: v for k, v in scene.parameters.items() if k not in ("copyright", "asset")}
    if parameters:
        own["parameters"] = json.loads(json.dumps(parameters, default=str))
    return own


def _extensions_used(root: Json) -> list[str]:
    used = []
    if "extensions" in root:
        used.append("KHR_lights_punctual")
    if any("extensions" in material for material in root["materials"]):
        used.append("KHR_materials_emissive_strength")
    if any("extensions" in channel["target"] for a in root.get("animations", []) for channel in a["channels"]):
        used.append("KHR_animation_pointer")
    return used


def _meshes(scene: Scene, binary: Binary) -> tuple[list[Json], dict[tuple[int, ...], int], list[list[int]]]:
    """glTF meshes, one for each set of Meshes that a node places; where each set went; [mesh, primitive] of every Scene mesh."""
    primitives = [_primitive(mesh, binary) for mesh in scene.meshes]
    placed = {node.meshes for node in scene.nodes}
    sets = list(dict.fromkeys(node.meshes for node in scene.nodes if node.meshes))
    loose = set(range(len(primitives))) - {i for row in placed for i in row}
    sets += [(i,) for i in sorted(loose)]
    order: dict[int, list[int]] = {}
    items = []
    for index, row in enumerate(sets):
        parts = []
        for k, mesh in enumerate(row):
            order.setdefault(mesh, [index, k])
            parts.append(put_extras(primitives[mesh], "", {"name": scene.meshes[mesh].name}) if len(row) > 1 else primitives[mesh])
        items.append(named(scene.meshes[row[0]].name, {"primitives": parts}))
    return items, {row: i for i, row in enumerate(sets)}, [order[i] for i in range(len(primitives))]


def _primitive(mesh: Mesh, binary: Binary) -> Json:
    attributes = {
        "POSITION": binary.accessor(mesh.positions.astype("<f4"), bounds=True),
        "NORMAL": binary.accessor(mesh.normals.astype("<f4")),
    }
    if mesh.uvs is not None:
        attributes["TEXCOORD_0"] = binary.accessor(mesh.uvs.astype("<f4"))
    # 65535 marks a primitive restart and may not be used as an index
    kind = "<u2" if len(mesh.positions) < 65535 else "<u4"
    return {
        "attributes": attributes,
        "indices": binary.accessor(mesh.triangles.astype(kind).reshape(-1)),
        "material": mesh.material,
    }


def _textures(textures: tuple[Texture, ...], binary: Binary) -> Json:
    if not textures:
        return {}
    from PIL import Image

    images, samplers, items = [], [], []
    for index, texture in enumerate(textures):
        file = io.BytesIO()
        Image.fromarray(texture.pixels).save(file, "PNG")
        images.append({"bufferView": binary.view(file.getvalue()), "mimeType": "image/png"})
        samplers.append({"wrapS": WRAPS[texture.wrap[0]], "wrapT": WRAPS[texture.wrap[1]]})
        items.append(named(texture.name, {"source": index, "sampler": index}))
    return {"images": images, "samplers": samplers, "textures": items}


def _nodes(scene: Scene, meshes: dict[tuple[int, ...], int]) -> list[Json]:
    children: list[list[int]] = [[] for _ in scene.nodes]
    for index, node in enumerate(scene.nodes):
        if node.parent is not None:
            children[node.parent].append(index)
    return [_node(node, row, meshes) for node, row in zip(scene.nodes, children, strict=True)]


def _node(node: Node, children: list[int], meshes: dict[tuple[int, ...], int]) -> Json:
    data = named(node.name, {"children": children} if children else {})
    if node.matrix is not None:
        data["matrix"] = node.matrix
    else:
        for key, value, default in (
            ("translation", node.translation, BLACK),
            ("rotation", node.rotation, (0.0, 0.0, 0.0, 1.0)),
            ("scale", node.scale, WHITE),
        ):
            # compared as text, so that -0.0 is written
            if repr(value) != repr(default):
                data[key] = value
    if node.meshes:
        data["mesh"] = meshes[node.meshes]
    if node.camera is not None:
        data["camera"] = node.camera
    if node.light is not None:
        data["extensions"] = {"KHR_lights_punctual": {"light": node.light}}
    return put_extras(data, node.extras, None, f"node {node.name!r}")


def _animation(scene: Scene, binary: Binary) -> Json:
    samplers, channels = [], []
    for index, channel in enumerate(scene.channels):
        samplers.append(_sampler(scene, channel, binary))
        channels.append({"sampler": index, "target": _target(channel)})
    return {"samplers": samplers, "channels": channels}


def _target(channel: Channel) -> Json:
    if channel.target == "node":
        return {"node": channel.index, "path": channel.path}
    if channel.target == "light":
        pointer = f"/extensions/KHR_lights_punctual/lights/{channel.index}/{channel.path}"
    else:
        pointer = f"/cameras/{channel.index}/perspective/{channel.path}"
    return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}


def _sampler(scene: Scene, channel: Channel, binary: Binary) -> Json:
    """float32 keys as glTF has them; the exact ones beside them where float32 can't hold them or they mean another quantity."""
    times, values = channel.times, channel.values
    light = scene.lights[channel.index] if channel.target == "light" else None
    area = face_on_area(light) if channel.path == "intensity" and isinstance(light, DiscLight | SphereLight) else None
    stored = (values * (1.0 if area is None else area)).astype("<f4").reshape(-1, values.shape[-1])
    data = {
        "input": binary.accessor(times.astype("<f4"), bounds=True),
        "output": binary.accessor(stored),
        "interpolation": channel.interpolation,
    }
    exact = area is None and np.array_equal(times.astype("<f4"), times) and np.array_equal(values.astype("<f4"), values)
    if exact:
        return data
    return put_extras(data, "", {"times": binary.raw(times, "float64"), "values": binary.raw(values, "float64")})
