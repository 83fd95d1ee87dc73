"""The node tree, lights and cameras (glTF 2.0, 3.5 and 3.10; KHR_lights_punctual); a cycle or a second parent is refused."""

from __future__ import annotations

import numpy as np

from renderers.scene.gltf.container import Document
from renderers.scene.gltf.element import Element
from renderers.scene.gltf.extras import foreign_extras, own_extras
from renderers.scene.gltf.materials import LUMENS_PER_WATT, MAX_RADIANCE, color
from renderers.scene.model import BLACK, WHITE, Camera, DirectionalLight, DiscLight, Light, Node, PointLight, SphereLight, SpotLight
from renderers.scene.notes import Notes

MAX_NODES = 100_000
MAX_INTENSITY = 1e30


def read_lights(document: Document, notes: Notes, *, photometric: bool) -> tuple[Light, ...]:
    """All lights of KHR_lights_punctual, in order."""
    extension = document.root.extension("KHR_lights_punctual")
    unit = 1 / LUMENS_PER_WATT if photometric else 1.0
    return () if extension is None else tuple(_light(item, notes, unit) for item in extension.objects("lights"))


def _light(item: Element, notes: Notes, unit: float) -> Light:
    kind = item.choice("type", ("point", "spot", "directional"))
    name, extras, own = item.text("name"), foreign_extras(item), own_extras(item)
    if own is not None and own.has("type"):
        area = DiscLight if own.choice("type", ("disc", "sphere")) == "disc" else SphereLight
        return area(
            name,
            color(own, "color"),
            own.number("radiance", low=0, high=MAX_RADIANCE),
            own.number("radius", low=0, high=1e12, above=True),
            extras,
        )
    notes.add("range of lights is ignored: they fall off with the square of the distance ({n} lights)", int(item.has("range")))
    rgb, intensity = color(item, "color", WHITE), item.number("intensity", 1.0, 0, MAX_INTENSITY) * unit
    if kind == "point":
        return PointLight(name, rgb, intensity, extras)
    if kind == "directional":
        return DirectionalLight(name, rgb, intensity, extras)
    spot = item.child("spot")
    outer = spot.number("outerConeAngle", np.pi / 4, 0, np.pi / 2 + 1e-6)
    inner = spot.number("innerConeAngle", 0.0, 0, np.pi / 2)
    if not inner < outer:
        raise spot.error(f"innerConeAngle {inner:g} must be less than outerConeAngle {outer:g}")
    return SpotLight(name, rgb, intensity, inner, outer, extras)


def read_cameras(document: Document, notes: Notes) -> tuple[tuple[Camera, ...], dict[int, int]]:
    """Perspective cameras, and where each camera of the file went (orthographic ones go nowhere)."""
    found: list[Camera] = []
    places: dict[int, int] = {}
    for index, item in enumerate(document.root.objects("cameras")):
        if item.choice("type", ("perspective", "orthographic")) == "orthographic":
            notes.add("orthographic cameras are ignored ({n} cameras)")
            continue
        places[index] = len(found)
        yfov = item.child("perspective").number("yfov", low=0, high=np.pi, above=True)
        found.append(Camera(item.text("name"), yfov, foreign_extras(item)))
    return tuple(found), places


def read_nodes(
    document: Document, meshes: list[tuple[int, ...]], lights: int, cameras: dict[int, int], notes: Notes
) -> tuple[tuple[Node, ...], dict[int, int]]:
    """Nodes of the active scene in file order, and where each node of the file went (those of other scenes go nowhere)."""
    items = document.root.objects("nodes")
    parents, alive = _tree(document, items, notes)
    places = {index: place for place, index in enumerate(i for i in range(len(items)) if alive[i])}
    notes.add("nodes outside the active scene are dropped ({n} nodes)", len(items) - len(places))
    stored = len(document.root.array("cameras"))
    nodes = []
    for index in places:
        parent = parents[index]
        nodes.append(_node(items[index], None if parent is None else places[parent], meshes, lights, (cameras, stored), notes))
    return tuple(nodes), places


def _tree(document: Document, items: list[Element], notes: Notes) -> tuple[list[int | None], list[bool]]:
    """Parent of every node, and which belong to the active scene."""
    count = len(items)
    children = [item.indices("children", count, "nodes") for item in items]
    parents: list[int | None] = [None] * count
    for parent, row in enumerate(children):
        for child in row:
            if parents[child] is not None:
                raise items[child].error(f"node has two parents, nodes[{parents[child]}] and nodes[{parent}]")
            parents[child] = parent
    if sum(_reached([i for i in range(count) if parents[i] is None], children)) < count:
        raise document.root.error("node graph has a cycle")
    scenes = document.root.objects("scenes")
    notes.add("scenes other than the active one are ignored ({n} scenes)", max(len(scenes) - 1, 0))
    active = document.root.index("scene", len(scenes), "scenes")
    if not scenes:
        return parents, [True] * count
    roots = scenes[active or 0].indices("nodes", count, "nodes")
    for root in roots:
        if parents[root] is not None:
            raise items[root].error(f"node has two parents, the scene and nodes[{parents[root]}]")
    return parents, _reached(roots, children)


def _reached(roots: list[int], children: list[list[int]]) -> list[bool]:
    seen = [False] * len(children)
    stack = list(roots)
    while stack:
        node = stack.pop()
        if not seen[node]:
            seen[node] = True
            stack.extend(children[node])
    return seen


def _node(
    item: Element,
    parent: int | None,
    meshes: list[tuple[int, ...]],
    lights: int,
    cameras: tuple[dict[int, int], int],
    notes: Notes,
) -> Node:
    mesh = item.index("mesh", len(meshes), "meshes")
    camera = item.index("camera", cameras[1], "cameras")
    extension = item.extension("KHR_lights_punctual")
    light = None if extension is None else extension.index("light", lights, "lights")
    notes.add("skins are ignored: their meshes stay in rest pose ({n} nodes)", int(item.has("skin")))
    matrix = item.numbers("matrix", 16) if item.has("matrix") else None
    if matrix is not None and (matrix[3], matrix[7], matrix[11], matrix[15]) != (0, 0, 0, 1):
        raise item.error("matrix must be affine: its last row 0, 0, 0, 1")
    x, y, z = item.numbers("translation", 3, BLACK)
    sx, sy, sz = item.numbers("scale", 3, WHITE)
    qx, qy, qz, qw = item.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    if not 0.5 < qx * qx + qy * qy + qz * qz + qw * qw < 2:
        raise item.error("rotation must be a unit quaternion")
    return Node(
        name=item.text("name"),
        parent=parent,
        translation=(x, y, z),
        rotation=(qx, qy, qz, qw),
        scale=(sx, sy, sz),
        matrix=matrix,
        meshes=() if mesh is None else meshes[mesh],
        light=light,
        camera=None if camera is None else cameras[0].get(camera),
        extras=foreign_extras(item),
    )
