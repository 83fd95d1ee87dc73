"""The Scene: an immutable description of what is to be rendered.

Conventions (all of them tested): metres, right-handed, +Y up, column vectors; a camera looks along its own -Z with +Y up, and
so do spot and directional lights shine along their own -Z (glTF 2.0). Colours are linear Rec.709 RGB. Radiance is in
W·sr⁻¹·m⁻², intensity of point and spot lights in W·sr⁻¹, of directional lights in W·m⁻². Rotations are unit quaternions
(x, y, z, w).

A Scene holds what a file says (node tree, instances, animation). Renderers do not walk it: they read `scene.world(frame)`, the
flattened and normalised view of one frame (see `world.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from renderers.scene.world import World

Color = tuple[float, float, float]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
BLACK: Color = (0.0, 0.0, 0.0)
WHITE: Color = (1.0, 1.0, 1.0)

NEEDS = (
    "diffuse", "glossy", "specular", "point_light", "directional_light", "spot_light",
    "area_light", "environment", "animated_geometry", "animated_light", "animated_camera",
)  # fmt: skip


class SceneError(ValueError):
    """A scene that can't be used: one line naming file, element and reason."""


@dataclass(frozen=True, eq=False)
class Texture:
    """Base-colour image. `pixels`: uint8 (H, W, 3), sRGB-encoded, row 0 on top, at v = 0 (glTF)."""

    name: str
    pixels: NDArray[np.uint8]
    wrap: tuple[Literal["repeat", "clamp", "mirror"], Literal["repeat", "clamp", "mirror"]] = ("repeat", "repeat")

    @cached_property
    def linear(self) -> NDArray[np.float32]:
        """Linear float32 (H, W, 3): the sRGB curve is undone before filtering, as GL's sRGB textures do."""
        v = self.pixels.astype(np.float64) / 255.0
        return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


@dataclass(frozen=True)
class Lambert:
    """f = albedo / π. `albedo` is multiplied by the texture where there is one."""

    name: str = ""
    albedo: Color = (0.8, 0.8, 0.8)
    texture: int | None = None
    emission: Color = BLACK
    double_sided: bool = True
    extras: str = ""


@dataclass(frozen=True)
class Phong:
    """f = diffuse / π + specular · (n + 2) / (2π) · max(0, r·ω_o)ⁿ, r the mirror of ω_i (Lafortune & Willems 1994)."""

    name: str = ""
    diffuse: Color = (0.5, 0.5, 0.5)
    specular: Color = (0.3, 0.3, 0.3)
    exponent: float = 20.0
    texture: int | None = None
    emission: Color = BLACK
    double_sided: bool = True
    extras: str = ""


@dataclass(frozen=True)
class GGX:
    """glTF 2.0 Appendix B metallic-roughness; α = max(roughness², 1e-3)."""

    name: str = ""
    base_color: Color = WHITE
    metallic: float = 1.0
    roughness: float = 1.0
    texture: int | None = None
    emission: Color = BLACK
    double_sided: bool = True
    extras: str = ""


Material = Lambert | Phong | GGX


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material, in local space. `normals` are unit; `uvs` may be missing.

    positions float32 (V, 3), normals float32 (V, 3), triangles uint32 (T, 3) counter-clockwise in front, uvs float32 (V, 2).
    """

    name: str
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    material: int
    uvs: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class PointLight:
    """Isotropic; `intensity` is color × strength in W/sr per channel."""

    name: str = ""
    color: Color = WHITE
    intensity: float = 1.0
    extras: str = ""


@dataclass(frozen=True)
class SpotLight:
    """glTF spot along the node's -Z: clamp((cos θ - cos outer) / (cos inner - cos outer))², angles in radians from the axis."""

    name: str = ""
    color: Color = WHITE
    intensity: float = 1.0
    inner_angle: float = 0.0
    outer_angle: float = np.pi / 4
    extras: str = ""


@dataclass(frozen=True)
class DirectionalLight:
    """Parallel light along the node's -Z; `intensity` is irradiance on a facing plane in W/m²."""

    name: str = ""
    color: Color = WHITE
    intensity: float = 1.0
    extras: str = ""


@dataclass(frozen=True)
class DiscLight:
    """Disc of `radius` metres in the node's XY plane, emitting `color × intensity` W·sr⁻¹·m⁻² along -Z.

    Flattened into triangles whose area is exactly that of the disc.
    """

    name: str = ""
    color: Color = WHITE
    intensity: float = 1.0
    radius: float = 0.5
    extras: str = ""


@dataclass(frozen=True)
class SphereLight:
    """Sphere of `radius` metres emitting `color × intensity` W·sr⁻¹·m⁻² outwards; flattened into triangles of exact area."""

    name: str = ""
    color: Color = WHITE
    intensity: float = 1.0
    radius: float = 0.1
    extras: str = ""


Light = PointLight | SpotLight | DirectionalLight | DiscLight | SphereLight


@dataclass(frozen=True)
class Camera:
    """Pinhole, square pixels; `yfov` is the full vertical angle in radians. Clip planes follow the bounds, not the file."""

    name: str = ""
    yfov: float = 0.8
    extras: str = ""


@dataclass(frozen=True)
class Node:
    """One node of the tree. `matrix` (16 numbers, column-major) replaces translation, rotation and scale where it is given."""

    name: str = ""
    parent: int | None = None
    translation: Vector = BLACK
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    scale: Vector = WHITE
    matrix: tuple[float, ...] | None = None
    meshes: tuple[int, ...] = ()
    light: int | None = None
    camera: int | None = None
    extras: str = ""


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from everywhere: `radiance` (constant) or `radiance` × `image` (lat-long float32 (H, W, 3), see `environment.py`)."""

    radiance: Color = WHITE
    image: NDArray[np.float32] | None = None
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Channel:
    """Keys of one animated property. CUBICSPLINE values have shape (K, 3, C): in-tangent, value, out-tangent; others (K, C)."""

    target: Literal["node", "light", "camera"]
    index: int
    path: Literal["translation", "rotation", "scale", "intensity", "color", "yfov"]
    times: NDArray[np.float64]
    values: NDArray[np.float64]
    interpolation: Literal["STEP", "LINEAR", "CUBICSPLINE"] = "LINEAR"


@dataclass(frozen=True, eq=False)
class Scene:
    """Immutable scene. `notes` lists all that the source said and the Scene can't hold; nothing is dropped silently."""

    name: str
    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = ()
    textures: tuple[Texture, ...] = ()
    nodes: tuple[Node, ...] = ()
    lights: tuple[Light, ...] = ()
    cameras: tuple[Camera, ...] = ()
    channels: tuple[Channel, ...] = ()
    environment: Environment | None = None
    fps: float = 24.0
    exposure: float | None = None
    notes: tuple[str, ...] = ()
    parameters: Mapping[str, object] = field(default_factory=dict)

    @cached_property
    def needs(self) -> frozenset[str]:
        """What the scene requires to be rendered right, a subset of NEEDS."""
        from renderers.scene.needs import needs_of

        return needs_of(self)

    @cached_property
    def hash(self) -> str:
        """Stable SHA-256 of everything that can change an image (names, notes and extras excepted)."""
        from renderers.scene.hashing import hash_of

        return hash_of(self)

    def at(self, frame: int) -> Scene:
        """The static scene at `frame` (time = frame / fps); values hold before the first and after the last key."""
        from renderers.scene.animation import posed

        return posed(self, frame) if self.channels else self

    @cached_property
    def _worlds(self) -> dict[int, World]:
        return {}

    def world(self, frame: int = 0) -> World:
        """The flattened, normalised view that renderers read; cached per frame (the last one only)."""
        from renderers.scene.world import flatten

        frame = frame if self.channels else 0
        if frame not in self._worlds:
            world = flatten(self, frame)
            self._worlds.clear()
            self._worlds[frame] = world
        return self._worlds[frame]

    def with_notes(self, *notes: str) -> Scene:
        """The same scene with more notes."""
        return replace(self, notes=self.notes + notes)
