"""What a glTF file says it holds, counted before it is read: nodes share meshes, so a small file may ask for endless work."""

from __future__ import annotations

from typing import Any

from renderers.scene.gltf.element import Element

MOST = {"drawn primitives": 100_000, "triangles": 50_000_000}


def check_declared(root: Element) -> None:
    """Raises SceneError where the nodes draw more than MOST: reading it would take minutes, or gigabytes."""
    counts = declared(root.data)
    for name, limit in MOST.items():
        if counts[name] > limit:
            raise root.error(f"{counts[name]} {name}, more than the limit of {limit}")


def declared(root: dict[str, Any]) -> dict[str, int]:
    """Nodes, and the primitives and triangles they draw, by what the JSON says. Malformed parts count as nothing."""
    accessors, meshes, nodes = (
        found if isinstance(found := root.get(key), list) else [] for key in ("accessors", "meshes", "nodes")
    )

    def corners(primitive: object) -> int:
        own = primitive if isinstance(primitive, dict) else {}
        attributes = own.get("attributes")
        place = own.get("indices", attributes.get("POSITION") if isinstance(attributes, dict) else None)
        accessor = accessors[place] if isinstance(place, int) and 0 <= place < len(accessors) else None
        count = accessor.get("count") if isinstance(accessor, dict) else 0
        return count if isinstance(count, int) else 0

    sizes = []
    for mesh in meshes:
        primitives = mesh.get("primitives") if isinstance(mesh, dict) else None
        listed = primitives if isinstance(primitives, list) else []
        sizes.append((len(listed), sum(map(corners, listed)) // 3))
    placed = [node.get("mesh") for node in nodes if isinstance(node, dict)]
    drawn = [sizes[place] for place in placed if isinstance(place, int) and 0 <= place < len(sizes)]
    return {"nodes": len(nodes), "drawn primitives": sum(n for n, _ in drawn), "triangles": sum(t for _, t in drawn)}
