"""A World in the input format of the Radiance lighting system, to render the same scene with its programs.

What becomes of what: Lambertian materials `plastic` without specularity or roughness; emissive ones `light`; flat-shaded triangles
`polygon`, smooth ones Wavefront files that `obj2mesh` turns into meshes; point lights small `light` spheres, directional ones a
`source` half a degree wide. Lengths are World units, radiances are kept. Everything else has no counterpart that would reflect the
same light, and is refused: glossy materials, textures, spot lights, environments, surfaces that emit from both sides.
Format: *The RADIANCE 5.1 Synthetic Imaging System*, reference manual, sections 2.1 and 2.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from renderers.scene.model import SceneError
from renderers.scene.world import LAMBERT, World, WorldCamera, WorldLight

BULB = 1e-4
SUN_ANGLE = 0.5
FLAT = 1e-5


@dataclass(frozen=True)
class Exported:
    """scene: the file for `oconv`, to be run in its folder. meshes: Wavefront files to give `obj2mesh` first, each to a file of the
    same name ending in .rtm."""

    scene: Path
    meshes: tuple[Path, ...]


def write_radiance(world: World, folder: Path) -> Exported:
    """Write a World into a folder (made if missing). Raises SceneError for what Radiance can't reflect in the same way."""
    _checked(world)
    folder.mkdir(parents=True, exist_ok=True)
    lines: list[str] = []
    meshes: list[Path] = []
    normals = world.normals[world.triangles].astype(np.float64)
    smooth = (np.abs(np.einsum("tvc,tc->tv", normals, world.face_normals)) < 1 - FLAT).any(axis=1)
    for m in np.unique(world.material):
        lines.append(_material(world, m))
        own = world.material == m
        flat = np.flatnonzero(own & ~smooth)
        lines += [f"m{m} polygon t{t} 0 0 9 {_numbers(world.positions[world.triangles[t]])}" for t in flat]
        if (own & smooth).any():
            meshes.append(_wavefront(world, np.flatnonzero(own & smooth), folder / f"m{m}.obj"))
            lines.append(f"m{m} mesh mesh{m} 1 m{m}.rtm 0 0")
    for index, light in enumerate(world.lights):
        lines += _light(light, index)
    path = folder / "scene.rad"
    path.write_text("\n".join(lines) + "\n")
    return Exported(path, tuple(meshes))


def view_arguments(camera: WorldCamera, size: tuple[int, int]) -> list[str]:
    """Options of `rpict`, `vwrays` and the like for a camera and an image of (width, height) pixels."""
    width, height = size
    tall = np.degrees(camera.yfov)
    wide = np.degrees(2 * np.arctan(np.tan(camera.yfov / 2) * width / height))
    right_up_back, position = camera.pose[:3, :3].T, camera.pose[:3, 3]
    vectors = {"-vp": position, "-vd": -right_up_back[2], "-vu": right_up_back[1], "-vh": [wide], "-vv": [tall]}
    options = ["-vtv", *(text for name, vector in vectors.items() for text in (name, *_numbers(vector).split()))]
    return [*options, "-x", str(width), "-y", str(height), "-pa", "0"]


def _checked(world: World) -> None:
    used = np.unique(world.material)
    table = world.materials
    refused = {
        "glossy materials": (table.kind[used] != LAMBERT).any(),
        "textures": (table.texture[used] >= 0).any(),
        "emission from both sides": (table.emits_both[used] & (table.emission[used] > 0).any(axis=1)).any(),
        "spot lights": any(light.kind == "spot" for light in world.lights),
        "an environment": world.environment is not None and any(world.environment.radiance),
    }
    for what, found in refused.items():
        if found:
            raise SceneError(f"the scene has {what}: Radiance's format has no counterpart")


def _material(world: World, m: int) -> str:
    emission = world.materials.emission[m]
    if emission.any():
        return f"void light m{m} 0 0 3 {_numbers(emission)}"
    return f"void plastic m{m} 0 0 5 {_numbers(world.materials.base[m])} 0 0"


def _light(light: WorldLight, index: int) -> list[str]:
    if light.kind == "directional":
        solid_angle = np.pi * np.sin(np.radians(SUN_ANGLE / 2)) ** 2
        shape = f"sun{index} source lamp{index} 0 0 4 {_numbers(-light.direction)} {SUN_ANGLE}"
        return [f"void light sun{index} 0 0 3 {_numbers(light.intensity / solid_angle)}", shape]
    shape = f"bulb{index} sphere lamp{index} 0 0 4 {_numbers(light.position)} {BULB}"
    return [f"void light bulb{index} 0 0 3 {_numbers(light.intensity / (np.pi * BULB**2))}", shape]


def _wavefront(world: World, triangles: np.ndarray, path: Path) -> Path:
    used, corners = np.unique(world.triangles[triangles], return_inverse=True)
    lines = [f"v {_numbers(p)}" for p in world.positions[used]] + [f"vn {_numbers(n)}" for n in world.normals[used]]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in corners.reshape(-1, 3) + 1]
    path.write_text("\n".join(lines) + "\n")
    return path


def _numbers(values: object) -> str:
    return " ".join(f"{value:.9g}" for value in np.asarray(values, np.float64).ravel())
