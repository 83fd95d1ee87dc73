"""Hand-made glTF files for tests: JSON and bytes put together without the writer under test."""

from __future__ import annotations

import numpy as np

from renderers.scene.gltf.container import pack_glb

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
UP = np.tile(np.array([0, 0, 1], np.float32), (3, 1))


class Maker:
    """A document in the making; `root` may be changed at will before `save`."""

    def __init__(self) -> None:
        self.binary = b""
        self.root = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0, 1, 2]}],
            "nodes": [
                {"mesh": 0},
                {"camera": 0, "translation": [0, 0, 3]},
                {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 2]},
            ],
            "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 10}]}},
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}}],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }

    def view(self, data: bytes, **more) -> int:
        """Add bytes as a buffer view."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.root["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(self.root["bufferViews"]) - 1

    def accessor(self, values, **more) -> int:
        """Add an array as an accessor of its dtype."""
        rows = np.asarray(values).reshape(len(values), -1)
        kind = rows.dtype.newbyteorder("<").str[1:]
        item = {
            "bufferView": self.view(rows.tobytes()),
            "componentType": COMPONENTS[kind],
            "count": len(rows),
            "type": TYPES[rows.shape[1]],
        }
        self.root["accessors"].append(item | more)
        return len(self.root["accessors"]) - 1

    def primitive(self, positions=TRIANGLE, normals=UP, indices=None, **more) -> dict:
        """Add a mesh of one primitive from arrays (or from accessor numbers) and return the primitive."""
        attributes = {"POSITION": positions if isinstance(positions, int) else self.accessor(positions)}
        if normals is not None:
            attributes["NORMAL"] = normals if isinstance(normals, int) else self.accessor(normals)
        part = {"attributes": attributes, "material": 0, **more}
        if indices is not None:
            part["indices"] = self.accessor(np.asarray(indices))
        self.root["meshes"].append({"primitives": [part]})
        return part

    def save(self, folder, name="made.glb"):
        """Write the file and return its path."""
        root = {k: v for k, v in self.root.items() if v != []}
        if self.binary:
            root["buffers"] = [{"byteLength": len(self.binary)}, *root.get("buffers", [])]
        path = folder / name
        path.write_bytes(pack_glb(root, self.binary))
        return path


def simple() -> Maker:
    """A triangle, a point light, a camera."""
    maker = Maker()
    maker.primitive()
    return maker
