"""Scenes: the model, glTF in and out, built-in scenes, animation, needs and validation."""

from renderers.scene.load import builtin_scenes, load_scene
from renderers.scene.model import Scene, SceneError

__all__ = ["Scene", "SceneError", "builtin_scenes", "load_scene"]
