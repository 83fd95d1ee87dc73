"""Built-in scenes: procedural, parametric, seeded. One module a scene family; BUILTIN maps names to builders."""

from __future__ import annotations

from collections.abc import Callable

from renderers.scene.builtin.boxes import cube_in_a_box, moving_light
from renderers.scene.builtin.colonnade import colonnade
from renderers.scene.builtin.cornell import cornell_box, cornell_glossy
from renderers.scene.builtin.empty_room import empty_room
from renderers.scene.builtin.enclosures import furnace, sphere_in_sphere
from renderers.scene.builtin.gears import gears
from renderers.scene.builtin.interior import interior
from renderers.scene.builtin.kite import kite
from renderers.scene.builtin.leaks import thin_wall
from renderers.scene.builtin.leaves import leaves
from renderers.scene.builtin.plates import corner, parallel_plates, rectangle_light
from renderers.scene.builtin.spheres import bouncing_spheres
from renderers.scene.model import Scene

BUILTIN: dict[str, Callable[..., Scene]] = {
    "bouncing-spheres": bouncing_spheres,
    "colonnade": colonnade,
    "corner": corner,
    "cornell-box": cornell_box,
    "cornell-glossy": cornell_glossy,
    "cube-in-a-box": cube_in_a_box,
    "empty-room": empty_room,
    "furnace": furnace,
    "gears": gears,
    "interior": interior,
    "kite": kite,
    "leaves": leaves,
    "moving-light": moving_light,
    "parallel-plates": parallel_plates,
    "rectangle-light": rectangle_light,
    "sphere-in-sphere": sphere_in_sphere,
    "thin-wall": thin_wall,
}
