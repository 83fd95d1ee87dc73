"""luxmeter's renderers: a Scene in, a Frame out.

scene = renderers.load_scene("cornell-box")
method = renderers.get_method("ir")
frame = method.render(scene, method.Settings(vpls=4096), size=(320, 180), seed=7)
"""

from renderers.frame import Frame, Stopwatch, Timing
from renderers.method import (
    TRANSPORTS,
    Claim,
    Method,
    SequenceMethod,
    Settings,
    Transport,
    UnknownMethod,
    UnsupportedScene,
    get_method,
    register,
    registered_methods,
    setting,
)
from renderers.scene import Scene, SceneError, builtin_scenes, load_scene

__all__ = [
    "TRANSPORTS",
    "Claim",
    "Frame",
    "Method",
    "Scene",
    "SceneError",
    "SequenceMethod",
    "Settings",
    "Stopwatch",
    "Timing",
    "Transport",
    "UnknownMethod",
    "UnsupportedScene",
    "builtin_scenes",
    "get_method",
    "load_scene",
    "register",
    "registered_methods",
    "setting",
]
