"""Child process that reads one uploaded scene: `python -m service.http.inspecting MEMORY SECONDS NODES TRIANGLES FILE NAME`.

Prints what the scene holds, or `error` in one line that calls the file NAME.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from service.http.limited import answer, limit_this_process

MOST_DRAWN = 100_000


def main(arguments: list[str]) -> int:
    """0 when the scene was read or refused; a crash is the parent's to tell."""
    memory, seconds, nodes, triangles, file, name = arguments
    limit_this_process(int(memory), int(seconds))
    from renderers import SceneError

    try:
        answer(inspect(file, int(nodes), int(triangles)))
    except SceneError as error:
        answer({"error": str(error).replace(file, name)})
    except MemoryError:
        answer({"error": f"{name}: needs more than {int(memory) / 2**20:.0f} MiB of memory"})
    except RecursionError:
        answer({"error": f"{name}: nested too deeply"})
    return 0


def inspect(file: str, most_nodes: int, most_triangles: int) -> dict[str, object]:
    """Read a scene; what it declares is counted before anything is read in full. Raises SceneError."""
    from renderers import SceneError, load_scene
    from renderers.scene.gltf.container import open_document

    counts = declared(open_document(Path(file)).root.data)
    for name, limit in (("nodes", most_nodes), ("drawn primitives", MOST_DRAWN), ("triangles", most_triangles)):
        if counts[name] > limit:
            raise SceneError(f"{file}: {counts[name]} {name}, more than the limit of {limit}")
    scene = load_scene(file)
    triangles = len(scene.world(0).triangles)
    if triangles > most_triangles:  # strips hold up to three times as many as their corners say
        raise SceneError(f"{file}: {triangles} triangles, more than the limit of {most_triangles}")
    return {"triangles": triangles, "needs": sorted(scene.needs), "hash": scene.hash, "notes": list(scene.notes)}


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
