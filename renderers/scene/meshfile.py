"""Mesh files without a scene, OBJ and PLY: grey where they name no material, seen through a framed camera, lit by a headlight.

PLY goes through trimesh. Its header is judged first, because a header may claim any number of elements.
"""

from __future__ import annotations

import io
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.files import read_limited
from renderers.scene.framing import checked, completed
from renderers.scene.geometry import cleaned
from renderers.scene.model import Lambert, Mesh, Scene, SceneError
from renderers.scene.notes import Notes
from renderers.scene.objfile import ObjReader

MAX_HEADER_BYTES = 2**16


def read_mesh_file(path: str | os.PathLike[str]) -> Scene:
    """The Scene of an .obj or .ply file, with a camera and a light of our own where it has none. Raises SceneError."""
    path = Path(path)
    scene, notes = SceneBuilder(path.stem), Notes()
    if path.suffix.lower() == ".obj":
        ObjReader(path, notes).read(scene)
    else:
        _read_ply(path, scene, notes)
    return completed(checked(replace(scene.build(), notes=notes.lines), str(path)), headlight=True)


def _read_ply(path: Path, scene: SceneBuilder, notes: Notes) -> None:
    from trimesh.exchange.ply import load_ply
    from trimesh.geometry import triangulate_quads

    data = read_limited(path)
    vertices, polygons = _declared(data, path)
    try:
        found = load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
        faces = np.asarray(triangulate_quads(found.get("faces", ()))).reshape(-1, 3)
    except Exception as error:
        # trimesh answers damaged data with ValueError, KeyError, IndexError, struct.error and more
        raise SceneError(f"{path}: file: not a readable PLY file ({type(error).__name__})") from None
    positions = np.asarray(found["vertices"], np.float32).reshape(-1, 3)
    if len(positions) != vertices or len(faces) < polygons:
        raise SceneError(
            f"{path}: file: header says {vertices} vertices and {polygons} faces, {len(positions)} and {len(faces)} read"
        )
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise SceneError(f"{path}: vertex {bad[0]}: position is not finite ({len(bad)} such vertices)")
    wrong = np.flatnonzero(((faces < 0) | (faces >= len(positions))).any(axis=1))
    if len(wrong):
        raise SceneError(f"{path}: triangle {wrong[0]}: an index names none of the {len(positions)} vertices")
    colors = any(found.get(key) is not None for key in ("vertex_colors", "face_colors"))
    notes.add("vertex and face colours are ignored: grey of albedo 0.8", int(colors))
    stored = found.get("vertex_normals")
    normals = None if stored is None else np.asarray(stored, np.float32)
    p, n, t, _, findings = cleaned(positions, normals, faces.astype(np.uint32))
    notes.findings(findings)
    if len(t):
        scene.meshes.append(Mesh(path.stem, p, n, t, scene.material(Lambert("grey"))))
        scene.node(name=path.stem, meshes=(0,))


def _declared(data: bytes, path: Path) -> tuple[int, int]:
    """Vertex and face counts of the header. Raises SceneError when the file is too short to hold them."""
    end = data.find(b"end_header", 0, MAX_HEADER_BYTES)
    if not data.startswith(b"ply") or end < 0:
        raise SceneError(f"{path}: header: not a PLY file")
    elements = re.findall(rb"^element\s+(\w+)\s+(\d{1,18})\s*$", data[:end], re.MULTILINE)
    for name, count in elements:
        # every element takes at least one byte
        if int(count) > len(data) - end:
            raise SceneError(f"{path}: header: {int(count)} {name.decode('ascii', 'replace')} elements don't fit in the file")
    counts = {name: int(count) for name, count in elements}
    return counts.get(b"vertex", 0), counts.get(b"face", 0)
