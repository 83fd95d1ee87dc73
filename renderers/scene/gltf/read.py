"""glTF 2.0 in: a .glb or .gltf file to a Scene, with a note on everything the file says and the Scene can't hold."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from renderers.scene.framing import checked, completed
from renderers.scene.gltf.accessors import Accessors
from renderers.scene.gltf.animation import Places, read_channels
from renderers.scene.gltf.container import open_document
from renderers.scene.gltf.declared import check_declared
from renderers.scene.gltf.element import Element, quoted
from renderers.scene.gltf.extras import own_extras, read_array
from renderers.scene.gltf.materials import color, read_materials, read_textures
from renderers.scene.gltf.meshes import MeshReader
from renderers.scene.gltf.nodes import MAX_NODES, read_cameras, read_lights, read_nodes
from renderers.scene.model import WHITE, Environment, Scene
from renderers.scene.notes import Notes

SUPPORTED = (
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_animation_pointer",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
)
EXTRAS_HELD = ("asset", "materials", "nodes", "cameras", "lights")


def read_gltf(path: str | os.PathLike[str], photometric: bool = False) -> Scene:
    """The Scene of a glTF 2.0 file. Raises SceneError, one line that names file, element and reason.

    photometric: intensities and emission are in candela, lux and nits and are divided by 683.
    """
    document = open_document(Path(path))
    root, notes = document.root, Notes()
    _check_asset(root, notes)
    check_declared(root)
    own = _own_scene(root)
    accessors = Accessors(document)
    textures, texture_places = read_textures(document, accessors, notes)
    uses = read_materials(document, texture_places, notes, photometric=photometric)
    reader = MeshReader(document, accessors, uses, notes)
    meshes = reader.read(_mesh_order(own))
    lights = read_lights(document, notes, photometric=photometric)
    cameras, camera_places = read_cameras(document, notes)
    nodes, node_places = read_nodes(document, meshes, len(lights), camera_places, notes)
    fixed = frozenset(i for i, node in enumerate(nodes) if node.matrix is not None)
    channels = read_channels(document, accessors, Places(node_places, camera_places, lights, fixed, photometric), notes)
    scene = Scene(
        name=_name(root, Path(path), own),
        meshes=tuple(reader.meshes),
        materials=tuple(use.material for use in uses),
        textures=textures,
        nodes=nodes,
        lights=lights,
        cameras=cameras,
        channels=channels,
        parameters=_parameters(root, own),
    )
    if own is not None:
        scene = _with_own(scene, own, accessors)
    finished = completed(checked(scene, root.file))
    # a file that we wrote already tells what was lost before; nothing is said twice
    return replace(finished, notes=tuple(dict.fromkeys((*scene.notes, *notes.lines, *finished.notes))))


def _check_asset(root: Element, notes: Notes) -> None:
    version = root.child("asset").text("version")
    if not version.startswith("2."):
        raise root.error(f"asset version {quoted(version)} is not supported, only 2.0")
    for name in root.array("extensionsRequired"):
        if name not in SUPPORTED:
            raise root.error(f"required extension {quoted(name)} is not supported")
    if len(root.array("nodes")) > MAX_NODES:
        raise root.error(f"{len(root.array('nodes'))} nodes, more than the limit of {MAX_NODES}")
    extensions, extras = _count_extensions(root.data)
    for name, count in extensions.items():
        notes.add(f"extension {quoted(name)} is ignored ({{n}} uses)", count if name not in SUPPORTED else 0)
    notes.add("extras of elements other than asset, materials, nodes, cameras and lights are not kept ({n} elements)", extras)


def _count_extensions(data: dict[str, Any]) -> tuple[dict[str, int], int]:
    """Uses of every extension anywhere in the document, and the number of foreign extras that no Scene field holds."""
    counts: dict[str, int] = {}
    lost = 0
    stack: list[tuple[Any, str]] = [(data, "")]
    while stack:
        value, kind = stack.pop()
        if isinstance(value, list):
            stack.extend((entry, kind) for entry in value)
        elif isinstance(value, dict):
            extensions = value.get("extensions")
            for name in extensions if isinstance(extensions, dict) else ():
                counts[name] = counts.get(name, 0) + 1
            extras = value.get("extras")
            lost += int(
                extras is not None and kind not in EXTRAS_HELD and not (isinstance(extras, dict) and set(extras) <= {"luxmeter"})
            )
            stack.extend((entry, key if key != "extensions" else kind) for key, entry in value.items() if key != "extras")
    return counts, lost


def _own_scene(root: Element) -> Element | None:
    scenes = root.objects("scenes")
    return own_extras(scenes[root.index("scene", len(scenes), "scenes") or 0]) if scenes else None


def _mesh_order(own: Element | None) -> list[list[int]]:
    order = [] if own is None else own.array("meshes")
    if own is not None and any(not isinstance(p, list) or any(not isinstance(i, int) or i < 0 for i in p) for p in order):
        raise own.error("meshes must be pairs of indices")
    return order


def _name(root: Element, path: Path, own: Element | None) -> str:
    """The name our writer gave, else the file's; `scene.glb` is called after its folder."""
    if own is not None:
        return own.text("name")
    return path.resolve().parent.name if path.stem == "scene" else path.stem


def _parameters(root: Element, own: Element | None) -> dict[str, object]:
    """Builder parameters that our writer kept, and whom a file is owed to: `copyright` and `asset` (the asset's extras)."""
    found = dict(own.child("parameters").data) if own is not None else {}
    asset = root.child("asset")
    found |= {"copyright": asset.text("copyright")} if asset.has("copyright") else {}
    return found | ({"asset": asset.data["extras"]} if asset.has("extras") else {})


def _with_own(scene: Scene, own: Element, accessors: Accessors) -> Scene:
    notes = own.array("notes")
    if any(not isinstance(line, str) for line in notes):
        raise own.error("notes must be strings")
    return replace(
        scene,
        fps=own.number("fps", 24.0, 0, 1e6, above=True),
        exposure=own.number("exposure", low=0, above=True) if own.has("exposure") else None,
        environment=_environment(own, accessors),
        notes=tuple(notes),
    )


def _environment(own: Element, accessors: Accessors) -> Environment | None:
    if not own.has("environment"):
        return None
    item = own.child("environment")
    image = read_array(item, "image", accessors, 3).astype(np.float32) if item.has("image") else None
    if image is not None and (image.shape[2] != 3 or (image < 0).any()):
        raise item.error("image must be (H, W, 3) and not negative")
    x, y, z, w = item.numbers("rotation", 4, (0, 0, 0, 1))
    if not 0.5 < x * x + y * y + z * z + w * w < 2:
        raise item.error("rotation must be a unit quaternion")
    return Environment(color(item, "radiance", WHITE), image, (x, y, z, w))
