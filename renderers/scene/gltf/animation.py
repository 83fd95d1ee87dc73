"""Animation channels (glTF 2.0, 3.11; KHR_animation_pointer for lights and cameras). All animations of a file play together."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from renderers.scene.gltf.accessors import Accessors
from renderers.scene.gltf.container import Document
from renderers.scene.gltf.element import Element
from renderers.scene.gltf.extras import own_extras, read_array
from renderers.scene.gltf.materials import LUMENS_PER_WATT
from renderers.scene.model import Channel, DiscLight, Light, SphereLight
from renderers.scene.notes import Notes

WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "intensity": 1, "color": 3, "yfov": 1}
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
LIGHT_POINTER = re.compile(r"/extensions/KHR_lights_punctual/lights/(\d{1,9})/(intensity|color)")
CAMERA_POINTER = re.compile(r"/cameras/(\d{1,9})/perspective/(yfov)")
NODE_POINTER = re.compile(r"/nodes/(\d{1,9})/(translation|rotation|scale)")
Target = tuple[Any, int, Any]


@dataclass(frozen=True)
class Places:
    """Where nodes and cameras of the file went, and the lights, to aim channels with."""

    nodes: dict[int, int]
    cameras: dict[int, int]
    lights: tuple[Light, ...]
    fixed: frozenset[int]
    photometric: bool


def read_channels(document: Document, accessors: Accessors, places: Places, notes: Notes) -> tuple[Channel, ...]:
    """Channels of all animations; of several that move one property the first is kept."""
    found: dict[Target, Channel] = {}
    for animation in document.root.objects("animations"):
        samplers = animation.objects("samplers")
        for item in animation.objects("channels"):
            target = _target(item.child("target"), places, notes)
            if target is None:
                continue
            if target in found:
                notes.add("further channels of a property that already moves are ignored ({n} channels)")
                continue
            index = item.index("sampler", len(samplers), "samplers")
            if index is None:
                raise item.error("names no sampler")
            found[target] = _channel(samplers[index], target, accessors, places)
    return tuple(found.values())


def _target(item: Element, places: Places, notes: Notes) -> Target | None:
    """(target, index, path) of a Channel, or None when it moves something a Scene can't hold."""
    path = item.text("path")
    if path == "weights":
        notes.add("animated morph weights are ignored ({n} channels)")
        return None
    pointer = item.extension("KHR_animation_pointer")
    if path == "pointer" and pointer is not None:
        return _pointed(item, pointer.text("pointer"), places, notes)
    node = item.data.get("node")
    if path not in WIDTHS or node is None:
        notes.add(f"animated {path[:32]!r} is ignored ({{n}} channels)")
        return None
    return _node_target(item, item.integer("node"), path, places, notes)


def _pointed(item: Element, text: str, places: Places, notes: Notes) -> Target | None:
    if match := NODE_POINTER.fullmatch(text):
        return _node_target(item, int(match[1]), match[2], places, notes)
    if (match := LIGHT_POINTER.fullmatch(text)) and int(match[1]) < len(places.lights):
        return "light", int(match[1]), match[2]
    if (match := CAMERA_POINTER.fullmatch(text)) and int(match[1]) in places.cameras:
        return "camera", places.cameras[int(match[1])], match[2]
    notes.add(f"animated {text[:80]!r} is ignored ({{n}} channels)")
    return None


def _node_target(item: Element, node: int, path: str, places: Places, notes: Notes) -> Target | None:
    if node not in places.nodes:
        notes.add("channels of nodes outside the active scene are ignored ({n} channels)")
        return None
    if places.nodes[node] in places.fixed:
        raise item.error(f"nodes[{node}] is animated and has a matrix; only one is allowed")
    return "node", places.nodes[node], path


def _channel(item: Element, target: Target, accessors: Accessors, places: Places) -> Channel:
    kind, index, path = target
    mode: Any = item.choice("interpolation", ("STEP", "LINEAR", "CUBICSPLINE"), "LINEAR")
    width = WIDTHS[path]
    own = own_extras(item)
    if own is not None and own.has("times"):
        times = read_array(own, "times", accessors, 1).astype(np.float64)
        values = read_array(own, "values", accessors, 3 if mode == "CUBICSPLINE" else 2).astype(np.float64)
    else:
        inputs = item.index("input", len(accessors), "accessors")
        outputs = item.index("output", len(accessors), "accessors")
        if inputs is None or outputs is None:
            raise item.error("needs input and output")
        times = accessors.floats(inputs, ("SCALAR",))[:, 0].astype(np.float64)
        values = accessors.floats(outputs, (KINDS[width],)).astype(np.float64) * _unit(target, places)
        values = values.reshape(-1, 3, width) if mode == "CUBICSPLINE" and len(values) % 3 == 0 else values
    _check(item, times, values, (len(times), 3, width) if mode == "CUBICSPLINE" else (len(times), width), path)
    return Channel(kind, index, path, times, values, mode)


def _unit(target: Target, places: Places) -> float:
    """Factor from stored intensities to those of the Scene."""
    kind, index, path = target
    if kind != "light" or path != "intensity":
        return 1.0
    light = places.lights[index]
    if isinstance(light, DiscLight | SphereLight):
        return 1.0 / (np.pi * light.radius**2)
    return 1.0 / LUMENS_PER_WATT if places.photometric else 1.0


def _check(item: Element, times: np.ndarray, values: np.ndarray, shape: tuple[int, ...], path: str) -> None:
    if values.shape != shape:
        raise item.error(f"{len(times)} keys need values of shape {shape}, got {values.shape}")
    if not np.isfinite(times).all() or not np.isfinite(values).all():
        raise item.error("keys must be finite")
    if times[0] < 0 or (np.diff(times) <= 0).any():
        raise item.error("times must be at least 0 and strictly increase")
    keys = values[:, 1] if values.ndim == 3 else values
    if path == "rotation" and (np.abs(np.linalg.norm(keys, axis=1) - 1) > 0.1).any():
        raise item.error("rotation keys must be unit quaternions")
    if path in ("intensity", "color") and (keys < 0).any():
        raise item.error(f"{path} must not be negative")
    if path == "yfov" and ((keys <= 0) | (keys >= np.pi)).any():
        raise item.error("yfov must be > 0 and < pi")
