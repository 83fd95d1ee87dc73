"""Child process that draws a scene's preview: `python -m service.http.drawing MEMORY SECONDS SCENE FILE`.

First hits of camera rays: albedo times the cosine to the viewer, emitters white, gamma 2.2. No light transport.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from service.http.limited import answer, limit_this_process

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from renderers.scene.world import World

SIZE = (384, 216)


def main(arguments: list[str]) -> int:
    """0 when the preview was drawn or the scene refused."""
    memory, seconds, name, file = arguments
    limit_this_process(int(memory), int(seconds))
    from PIL import Image

    from jobs.scenes import open_scene
    from renderers import SceneError

    try:
        Image.fromarray(shade(open_scene(name).scene.world(0))).save(Path(file), "png")
        answer({})
    except SceneError as error:
        answer({"error": str(error)})
    return 0


def shade(world: World) -> NDArray[np.uint8]:
    """Shaded first hits, uint8 (H, W, 3), row 0 on top."""
    import numpy as np
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    caster = EmbreeScene()
    TriangleMesh(caster, np.ascontiguousarray(world.positions[world.triangles]))
    origins, ways = (np.ascontiguousarray(a.reshape(-1, 3), np.float32) for a in world.camera.rays(SIZE))
    hit = caster.run(origins, ways)
    cosine = np.abs(np.einsum("pi,pi->p", world.face_normals[hit], ways))
    color = np.clip(world.materials.base[world.material[hit]], 0, 1) * (0.25 + 0.75 * cosine)[:, None]
    color[np.isin(hit, world.emissive)] = 1
    color[hit < 0] = 0.1
    pixels: NDArray[np.uint8] = (255 * color ** (1 / 2.2)).astype(np.uint8).reshape(SIZE[1], SIZE[0], 3)
    return pixels


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
