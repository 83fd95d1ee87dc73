"""How much surface a scene has: one number that settings are derived from, reckoned once for each Scene."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from renderers.scene.model import Scene

_SURFACES: WeakKeyDictionary[Scene, float] = WeakKeyDictionary()


def rest_surface(scene: Scene) -> float:
    """Area in m² of all triangles at frame 0, light shapes included; kept, so that later frames don't flatten frame 0 again.

    Raises SceneError as `Scene.world` does.
    """
    if scene not in _SURFACES:
        world = scene.world()
        _SURFACES[scene] = float(world.areas.sum()) / world.scale**2
    return _SURFACES[scene]
