"""glTF 2.0 in (.glb, .gltf) and out (.glb)."""

from renderers.scene.gltf.read import read_gltf
from renderers.scene.gltf.write import write_gltf

__all__ = ["read_gltf", "write_gltf"]
