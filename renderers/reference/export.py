"""World → Mitsuba scene: what Mitsuba traces is, triangle for triangle, what the other renderers draw.

* One mesh a material, in World units (centre at the origin, half diagonal 1): Mitsuba's absolute ray offsets become relative.
* Every BSDF is `twosided`. Lambert is Mitsuba's `diffuse`; Phong, GGX, textures, glTF spots, two-sided emitters are our plugins.
* Interpolated normals are kept, except on emissive meshes: Mitsuba turns the density per area of a light into one per solid angle
  with the interpolated normal, which is right for the geometric one only.
* Environment images are Mitsuba's `envmap` before rotation. +Y is the top row, -Z the left edge (u = 0), +X u = 1/4, +Z u = 1/2,
  -X u = 3/4: u = atan2(x, -z) / 2π, texel column k spans [k, k + 1] / W; v = acos(y) / π, row k lies at v = k / (H - 1), so that
  the first and last row are the poles; bilinear between. A direction d of the World looks the image up at Rᵀd, R the matrix of
  `Environment.rotation`.
* Only what is lit or seen is exported: lights of zero intensity, black emitters and environments, unused materials are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.reference import bsdf_ggx, bsdf_phong, emitter_both, emitter_spot  # noqa: F401  (registers the plugins)
from renderers.reference.texture import texture
from renderers.reference.variant import mitsuba
from renderers.scene.model import Environment
from renderers.scene.world import GGX_KIND, PHONG, World, WorldLight, rotation_matrix

mi = mitsuba()


def mitsuba_scene(world: World, size: tuple[int, int], *, clay: bool = False) -> Any:
    """Mitsuba scene of `world` with a film of `size` (width, height).

    clay: the scene of ambient occlusion, all materials Lambert of albedo 1, no lights, no emitters, no environment.
    """
    parts: dict[str, Any] = {"type": "scene", "sensor": sensor(world, size)}
    for material in np.unique(world.material):
        parts[f"mesh{material}"] = _mesh(world, int(material), clay)
    if not clay:
        for index, light in enumerate(world.lights):
            if np.any(light.intensity > 0):
                parts[f"light{index}"] = _light(light)
        if world.environment is not None and any(world.environment.radiance):
            parts["environment"] = _environment(world.environment)
    return mi.load_dict(parts)


def sensor(world: World, size: tuple[int, int]) -> dict[str, Any]:
    """Camera, box filter and film as a Mitsuba dictionary; agrees with WorldCamera.rays in every pixel centre."""
    near, far = world.clip
    flip = np.diag([-1.0, 1.0, -1.0, 1.0])  # Mitsuba cameras look along +Z with +X to the left
    return {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f(world.camera.pose @ flip),
        "fov": float(np.degrees(world.camera.yfov)),
        "fov_axis": "y",
        "near_clip": near,
        "far_clip": far,
        "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}},
    }


def _mesh(world: World, material: int, clay: bool) -> Any:
    triangles = world.triangles[world.material == material]
    used, faces = np.unique(triangles, return_inverse=True)
    emission = world.materials.emission[material]
    emissive = bool(emission.any()) and not clay
    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": _diffuse(np.ones(3)) if clay else _bsdf(world, material)})
    if emissive:
        props["emitter"] = mi.load_dict(_area(emission, bool(world.materials.emits_both[material])))
    mesh = mi.Mesh(
        f"mesh{material}", len(used), len(triangles), props=props, has_vertex_normals=not emissive, has_vertex_texcoords=True
    )
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = mi.Float(world.positions[used].ravel())
    if not emissive:
        buffers["vertex_normals"] = mi.Float(world.normals[used].ravel())
    buffers["vertex_texcoords"] = mi.Float(world.uvs[used].ravel())
    buffers["faces"] = mi.UInt32(faces.ravel().astype(np.uint32))
    buffers.update()
    return mesh


def _bsdf(world: World, material: int) -> dict[str, Any]:
    table = world.materials
    base = table.base[material]
    index = int(table.texture[material])
    if index >= 0:
        image = world.textures[index]
        colour = texture(image.linear * base, image.wrap)
    else:
        colour = _rgb(base)
    if table.kind[material] == PHONG:
        specular = table.specular[material].astype(float)
        weight = float(specular.max()), float(base.max())
        return {
            "type": "luxmeter_phong",
            "diffuse": colour,
            **_channels("specular", specular),
            "exponent": float(table.exponent[material]),
            "split": weight[0] / sum(weight) if sum(weight) > 0 else 0.0,
        }
    if table.kind[material] == GGX_KIND:
        return {
            "type": "luxmeter_ggx",
            "base": colour,
            "metallic": float(table.metallic[material]),
            "alpha": float(table.alpha[material]),
        }
    return {"type": "diffuse", "reflectance": colour}


def _diffuse(albedo: NDArray[Any]) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": _rgb(albedo)}


def _area(emission: NDArray[Any], both: bool) -> dict[str, Any]:
    if both:
        return {"type": "luxmeter_area_both", **_channels("radiance", emission)}
    return {"type": "area", "radiance": _rgb(emission)}


def _light(light: WorldLight) -> dict[str, Any]:
    if light.kind == "point":
        return {"type": "point", "position": list(light.position), "intensity": _rgb(light.intensity)}
    if light.kind == "directional":
        return {"type": "directional", "direction": list(light.direction), "irradiance": _rgb(light.intensity)}
    return {
        "type": "luxmeter_spot",
        "position": mi.ScalarPoint3f(light.position),
        "axis": mi.ScalarVector3f(light.direction),
        **_channels("intensity", light.intensity),
        "cos_inner": light.cos_inner,
        "cos_outer": light.cos_outer,
    }


def _environment(environment: Environment) -> dict[str, Any]:
    if environment.image is None:
        return {"type": "constant", "radiance": _rgb(environment.radiance)}
    pixels = (environment.image * np.array(environment.radiance)).astype(np.float32)
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrix(environment.rotation)
    return {"type": "envmap", "bitmap": mi.Bitmap(_at_least_2x3(pixels)), "to_world": mi.ScalarTransform4f(pose)}


def _at_least_2x3(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same function on a grid that Mitsuba takes: tripled columns contain the centres of the old ones, so its pieces stay."""
    height, width, _ = pixels.shape
    if width < 3:
        at = (np.arange(3 * width) + 0.5) / 3 - 0.5
        left = np.floor(at).astype(int)
        t = (at - left)[None, :, None]
        pixels = (1 - t) * pixels[:, left % width] + t * pixels[:, (left + 1) % width]
    return np.ascontiguousarray(np.repeat(pixels, 2, axis=0) if height == 1 else pixels, np.float32)


def _rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(v) for v in value]}


def _channels(name: str, value: Any) -> dict[str, float]:
    return {f"{name}_{c}": float(v) for c, v in zip("rgb", value, strict=True)}
