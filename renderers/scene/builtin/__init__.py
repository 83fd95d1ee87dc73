"""Built-in scenes: procedural, parametric, seeded. One module a scene family; BUILTIN maps names to builders."""

from __future__ import annotations

from collections.abc import Callable

from renderers.scene.builtin.cornell import cornell_box
from renderers.scene.model import Scene

BUILTIN: dict[str, Callable[..., Scene]] = {
    "cornell-box": cornell_box,
}
