"""Find a scene by name or path."""

from __future__ import annotations

import os
from pathlib import Path

from renderers.scene.model import Scene, SceneError

SUFFIXES = (".glb", ".gltf", ".obj", ".ply")


def builtin_scenes() -> dict[str, str]:
    """Names of the built-in scenes and one line on each."""
    from renderers.scene.builtin import BUILTIN

    return {name: (builder.__doc__ or "").strip().splitlines()[0] for name, builder in sorted(BUILTIN.items())}


def load_scene(name: str | os.PathLike[str], *, photometric: bool = False, **parameters: object) -> Scene:
    """A built-in scene by name (with its parameters), or a file: .glb, .gltf, .obj, .ply, or a folder name under LUXMETER_SCENES.

    photometric divides light intensities and emission of a glTF file by 683 (candela, lux and nits to radiometric units).
    Raises SceneError.
    """
    from renderers.scene.builtin import BUILTIN

    text = os.fspath(name)
    if text in BUILTIN:
        return BUILTIN[text](**parameters)
    if parameters:
        raise SceneError(f"{text}: only built-in scenes take parameters")
    path = Path(text)
    folder = os.environ.get("LUXMETER_SCENES")
    if path.suffix.lower() not in SUFFIXES and folder and path.name == text:
        path = Path(folder) / text / "scene.glb"
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        raise SceneError(f"unknown scene {text!r}; built-in: {', '.join(sorted(BUILTIN))}; or a path to {', '.join(SUFFIXES)}")
    if path.suffix.lower() in (".glb", ".gltf"):
        from renderers.scene.gltf import read_gltf

        return read_gltf(path, photometric=photometric)
    from renderers.scene.meshfile import read_mesh_file

    return read_mesh_file(path)
