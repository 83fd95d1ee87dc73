"""Child process that reads one uploaded scene: `python -m service.http.inspecting MEMORY SECONDS NODES TRIANGLES FILE NAME`.

Prints what the scene holds, or `error` in one line that calls the file NAME.
"""

from __future__ import annotations

import sys
from pathlib import Path

from service.http.limited import answer, limit_this_process


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
    from renderers.scene.gltf.declared import declared

    counts = declared(open_document(Path(file)).root.data)
    for name, limit in (("nodes", most_nodes), ("triangles", most_triangles)):
        if counts[name] > limit:
            raise SceneError(f"{file}: {counts[name]} {name}, more than the limit of {limit}")
    scene = load_scene(file)
    triangles = len(scene.world(0).triangles)
    if triangles > most_triangles:  # strips hold up to three times as many as their corners say
        raise SceneError(f"{file}: {triangles} triangles, more than the limit of {most_triangles}")
    return {"triangles": triangles, "needs": sorted(scene.needs), "hash": scene.hash, "notes": list(scene.notes)}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
