"""Primitives to Meshes: one Mesh a primitive, cleaned; primitives of the same accessors and material share one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from renderers.scene.geometry import F32, U32, cleaned
from renderers.scene.gltf.accessors import Accessors
from renderers.scene.gltf.container import Document
from renderers.scene.gltf.element import Element
from renderers.scene.gltf.extras import compact, own_extras
from renderers.scene.gltf.materials import DEFAULT, MaterialUse
from renderers.scene.model import Mesh
from renderers.scene.notes import Notes

MAX_TRIANGLES = 20_000_000
TRIANGLES, STRIP, FAN = 4, 5, 6
HELD = ("POSITION", "NORMAL", "TEXCOORD_0")


@dataclass
class MeshReader:
    """Collects the Meshes of a document. `uses` are its materials; a default one is added when a primitive names none."""

    document: Document
    accessors: Accessors
    uses: list[MaterialUse]
    notes: Notes
    meshes: list[Mesh] = field(default_factory=list)
    _known: dict[str, int | None] = field(default_factory=dict)
    _triangles: int = 0
    _default: int | None = None

    def read(self, order: list[list[int]]) -> list[tuple[int, ...]]:
        """Indices into `meshes` for every mesh of the file; primitives named in `order` ([mesh, primitive] pairs) come first."""
        items = self.document.root.objects("meshes")
        primitives = [item.objects("primitives") for item in items]
        for pair in order:
            if len(pair) == 2 and pair[0] < len(primitives) and pair[1] < len(primitives[pair[0]]):
                self._mesh(items[pair[0]], primitives[pair[0]][pair[1]])
        found = []
        for item, parts in zip(items, primitives, strict=True):
            if item.has("weights") or any(part.has("targets") for part in parts):
                self.notes.add("morph targets are ignored ({n} meshes)")
            indices = [self._mesh(item, part) for part in parts]
            found.append(tuple(i for i in indices if i is not None))
        return found

    def _mesh(self, item: Element, part: Element) -> int | None:
        own = own_extras(part)
        name = item.text("name") if own is None else own.text("name", item.text("name"))
        key = compact([name, *(part.data.get(k) for k in ("attributes", "indices", "mode", "material"))])
        if key not in self._known:
            mesh = self._read(part, name)
            self._known[key] = None if mesh is None else len(self.meshes)
            if mesh is not None:
                self.meshes.append(mesh)
        return self._known[key]

    def _read(self, part: Element, name: str) -> Mesh | None:
        mode = part.integer("mode", TRIANGLES, 0, 6)
        if mode < TRIANGLES:
            self.notes.add("points and lines are ignored ({n} primitives)")
            return None
        material = self._material(part)
        use = self.uses[material]
        attributes = part.child("attributes")
        for attribute in attributes.data:
            self.notes.add(f"attribute {attribute[:32]!r} is ignored ({{n}} primitives)", int(attribute not in HELD))
        if use.removed:
            return None
        positions, normals, uvs = self._vertices(attributes, part)
        triangles = self._topology(part, mode, positions)
        uvs = self._coordinates(uvs, use)
        positions, normals, triangles, uvs, findings = cleaned(positions, normals, triangles, uvs)
        self.notes.findings(findings)
        return Mesh(name, positions, normals, triangles, material, uvs) if len(triangles) else None

    def _material(self, part: Element) -> int:
        named = len(self.uses) if self._default is None else len(self.uses) - 1
        index = part.index("material", named, "materials")
        if index is not None:
            return index
        if self._default is None:
            self._default = len(self.uses)
            self.uses.append(DEFAULT)
        return self._default

    def _vertices(self, attributes: Element, part: Element) -> tuple[F32, F32 | None, F32 | None]:
        arrays: dict[str, F32] = {}
        for key, kind in zip(HELD, ("VEC3", "VEC3", "VEC2"), strict=True):
            index = attributes.index(key, len(self.accessors), "accessors")
            if index is not None:
                arrays[key] = self.accessors.floats(index, (kind,))
                if key == "NORMAL" and self.accessors.is_integer(index):
                    # quantised normals are unit up to the quantisation: scale them without a word
                    length = np.linalg.norm(arrays[key], axis=1, keepdims=True)
                    arrays[key] = (arrays[key] / np.where(length > 0, length, 1)).astype(np.float32)
        if "POSITION" not in arrays:
            raise part.error("has no POSITION")
        if len({len(a) for a in arrays.values()}) != 1:
            raise part.error("attributes differ in count")
        for key in [k for k in ("POSITION", "TEXCOORD_0") if k in arrays]:
            bad = np.flatnonzero(~np.isfinite(arrays[key]).all(axis=1))
            if len(bad):
                raise part.error(f"vertex {bad[0]}: {key} is not finite ({len(bad)} such vertices)")
        return arrays["POSITION"], arrays.get("NORMAL"), arrays.get("TEXCOORD_0")

    def _topology(self, part: Element, mode: int, positions: F32) -> U32:
        index = part.index("indices", len(self.accessors), "accessors")
        if index is None:
            corners = np.arange(len(positions), dtype=np.uint32)
        else:
            corners = self.accessors.indices(index)
            if corners.max() >= len(positions):
                at = int(np.argmax(corners >= len(positions)))
                raise part.error(f"accessors[{index}]: index {corners[at]} at {at} names none of the {len(positions)} vertices")
        if mode == TRIANGLES and len(corners) % 3:
            raise part.error(f"{len(corners)} corners are no whole triangles")
        triangles = _triangles(corners, mode)
        self._triangles += len(triangles) + len(positions) // 2
        if self._triangles > MAX_TRIANGLES:
            raise part.error(f"more than {MAX_TRIANGLES} triangles in all meshes")
        return triangles

    def _coordinates(self, uvs: F32 | None, use: MaterialUse) -> F32 | None:
        if uvs is None:
            self.notes.add("textured without TEXCOORD_0: one texel everywhere ({n} primitives)", int(use.textured))
            return None
        if use.uv_transform is None:
            return uvs
        moved = uvs.astype(np.float64) @ use.uv_transform[:, :2].T + use.uv_transform[:, 2]
        limit = np.finfo(np.float32).max
        return np.clip(moved, -limit, limit).astype(np.float32)


def _triangles(corners: NDArray[np.uint32], mode: int) -> U32:
    """uint32 (T, 3) of a triangle list, strip or fan (glTF 2.0, 3.7.2.1)."""
    if mode == TRIANGLES:
        return corners.reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    k = np.arange(count)
    if mode == FAN:
        return np.stack([corners[k + 1], corners[k + 2], np.full(count, corners[0])], axis=1)
    odd = k % 2
    return np.stack([corners[k], corners[k + 1 + odd], corners[k + 2 - odd]], axis=1)
