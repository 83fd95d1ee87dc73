"""Wavefront OBJ: one mesh for each material, polygons cut into fans, Kd and Ke of the material library beside the file.

Every index is checked and every number that is none is refused with its line, because a dropped line would shift all later indices.
Textures, smoothing groups, lines and points are noted and ignored.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.files import read_limited, sibling
from renderers.scene.geometry import cleaned
from renderers.scene.model import BLACK, Color, Lambert, Mesh, SceneError
from renderers.scene.notes import Notes

MAX_OBJ_BYTES = 128 * 2**20
HARMLESS = frozenset({"o", "g", "s", "vt", "mtllib", "usemtl", "newmtl", "map_kd"})


@dataclass
class _Group:
    """Triangles of one material: rows of (vertex, normal) indices, three rows a triangle; normal -1 where there is none."""

    corners: list[tuple[int, int]] = field(default_factory=list)


@dataclass
class ObjReader:
    """State of one pass over the lines of an OBJ file."""

    path: Path
    notes: Notes
    positions: list[tuple[float, ...]] = field(default_factory=list)
    normals: list[tuple[float, ...]] = field(default_factory=list)
    groups: dict[str, _Group] = field(default_factory=dict)
    materials: dict[str, Lambert] = field(default_factory=dict)
    material: str = ""

    def read(self, scene: SceneBuilder) -> None:
        """Add meshes, materials and nodes of the file to `scene`. Raises SceneError."""
        text = read_limited(self.path, MAX_OBJ_BYTES).decode("utf-8", "replace").replace("\\\n", " ")
        for number, line in enumerate(text.split("\n"), 1):
            words = line.split("#", 1)[0].split()
            if words:
                self._line(words[0], words[1:], number)
        for name, group in self.groups.items():
            self._place(scene, name, group)

    def _line(self, key: str, words: list[str], number: int) -> None:
        if key == "v":
            self.positions.append(self._numbers(words[:3], number))
        elif key == "vn":
            self.normals.append(self._numbers(words, number))
        elif key == "f":
            self._face(words, number)
        elif key == "usemtl":
            self.material = " ".join(words)
        elif key == "mtllib":
            self._library(" ".join(words), number)
        elif key not in HARMLESS:
            self.notes.add(f"OBJ statement {key[:32]!r} is ignored ({{n}} lines)")

    def _numbers(self, words: list[str], number: int, low: float = -math.inf) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in words)
        except ValueError:
            values = ()
        if len(values) != 3 or not all(math.isfinite(v) and abs(v) < 3e38 and v >= low for v in values):
            raise self.error(number, f"needs three finite numbers, got {' '.join(words)[:48]!r}")
        return values

    def _face(self, words: list[str], number: int) -> None:
        corners = [self._corner(word, number) for word in words]
        if len(corners) < 3:
            raise self.error(number, "a face needs three corners")
        group = self.groups.setdefault(self.material, _Group())
        for second, third in itertools.pairwise(corners[1:]):
            group.corners += [corners[0], second, third]

    def _corner(self, word: str, number: int) -> tuple[int, int]:
        parts = word.split("/")
        vertex = self._index(parts[0], len(self.positions), number)
        normal = self._index(parts[2], len(self.normals), number) if len(parts) == 3 and parts[2] else -1
        return vertex, normal

    def _index(self, word: str, count: int, number: int) -> int:
        try:
            value = int(word)
        except ValueError:
            raise self.error(number, f"index {word[:32]!r} is no integer") from None
        index = value - 1 if value > 0 else count + value
        if value == 0 or not 0 <= index < count:
            raise self.error(number, f"index {value} names none of the {count} read so far")
        return index

    def _library(self, name: str, number: int) -> None:
        path = sibling(self.path.parent, name)
        if path is None:
            self.notes.add(f"material library {name[:48]!r} is no plain name of a file beside the scene: ignored")
            return
        current = ""
        for at, line in enumerate(read_limited(path, MAX_OBJ_BYTES).decode("utf-8", "replace").split("\n"), 1):
            words = line.split("#", 1)[0].split()
            key = words[0].lower() if words else ""
            if key == "newmtl":
                current = " ".join(words[1:])
                self.materials[current] = Lambert(current)
            elif key in ("kd", "ke") and current in self.materials:
                self._color(path, at, current, key, words[1:])
            elif key.startswith("map_") or key in ("ks", "ns", "d", "tr"):
                self.notes.add(f"{words[0][:32]} of OBJ materials is ignored ({{n}} materials)")

    def _color(self, path: Path, at: int, name: str, key: str, words: list[str]) -> None:
        red, green, blue = ObjReader(path, self.notes)._numbers(words, at, low=0.0)
        old = self.materials[name]
        if key == "kd" and max(red, green, blue) > 1:
            raise SceneError(f"{path}: line {at}: Kd must lie in [0, 1]")
        color: Color = (red, green, blue)
        albedo, emission = (color, old.emission) if key == "kd" else (old.albedo, color)
        self.materials[name] = Lambert(name, albedo, emission=emission, double_sided=emission == BLACK)

    def _place(self, scene: SceneBuilder, name: str, group: _Group) -> None:
        corners = np.array(group.corners, np.int64)
        if name and name not in self.materials:
            self.notes.add(f"material {name[:48]!r} is not in any library: grey of albedo 0.8")
        material = scene.material(self.materials.get(name, Lambert(name)))
        lit = bool((corners[:, 1] >= 0).all())
        rows, inverse = np.unique(corners if lit else corners[:, :1], axis=0, return_inverse=True)
        positions = np.array(self.positions, np.float32)[rows[:, 0]]
        normals = np.array(self.normals, np.float32)[rows[:, 1]] if lit else None
        triangles = inverse.reshape(-1, 3).astype(np.uint32)
        p, n, t, _, found = cleaned(positions, normals, triangles)
        self.notes.findings(found)
        if len(t):
            scene.meshes.append(Mesh(name or self.path.stem, p, n, t, material))
            scene.node(name=name or self.path.stem, meshes=(len(scene.meshes) - 1,))

    def error(self, number: int, reason: str) -> SceneError:
        """The refusal of a line; raise it."""
        return SceneError(f"{self.path}: line {number}: {reason}")
