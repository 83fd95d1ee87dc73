"""A World as a diffuse Mitsuba scene, and radiance along pixel-centre rays: an oracle written apart from the exporter."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World, rotation_matrix


def mitsuba() -> Any:
    """Mitsuba with its LLVM variant set."""
    from renderers.reference.variant import mitsuba

    return mitsuba()


def rgb(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(v) for v in values]}


def scene_of(world: World) -> Any:
    """Two-sided Lambert surfaces, front-emitting triangles, point and directional lights, environment."""
    mi = mitsuba()
    parts: dict[str, Any] = {"type": "scene"}
    for m in np.unique(world.material):
        faces = world.triangles[world.material == m]
        props = mi.Properties()
        props["bsdf"] = mi.load_dict(
            {"type": "twosided", "inner": {"type": "diffuse", "reflectance": rgb(world.materials.base[m])}}
        )
        if world.materials.emission[m].any():
            props["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(world.materials.emission[m])})
        mesh = mi.Mesh(f"mesh{m}", len(world.positions), len(faces), has_vertex_normals=True, props=props)
        arrays = mi.traverse(mesh)
        arrays["vertex_positions"] = world.positions.ravel()
        arrays["vertex_normals"] = world.normals.ravel()
        arrays["faces"] = faces.astype(np.uint32).ravel()
        arrays.update()
        parts[f"mesh{m}"] = mesh
    for k, light in enumerate(world.lights):
        if light.kind == "point":
            parts[f"light{k}"] = {"type": "point", "position": light.position.tolist(), "intensity": rgb(light.intensity)}
        else:
            parts[f"light{k}"] = {"type": "directional", "direction": light.direction.tolist(), "irradiance": rgb(light.intensity)}
    if world.environment is not None:
        parts["sky"] = sky_of(world.environment)
    return mi.load_dict(parts)


def sky_of(environment: Any) -> dict[str, Any]:
    """Constant or envmap emitter of an Environment."""
    mi = mitsuba()
    if environment.image is None:
        return {"type": "constant", "radiance": rgb(environment.radiance)}
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrix(environment.rotation)
    bitmap = mi.Bitmap(np.ascontiguousarray(environment.image * np.array(environment.radiance, np.float32)))
    return {"type": "envmap", "bitmap": bitmap, "to_world": mi.ScalarTransform4f(pose)}


def path_traced(
    world: World, size: tuple[int, int], max_depth: int, spp: int, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard error of `path` along pixel-centre rays: float64 (H, W, 3) each; zero error for one sample."""
    mi = mitsuba()
    origins, directions = (np.repeat(a.reshape(-1, 3), spp, axis=0).astype(np.float32) for a in world.camera.rays(size))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(origins))
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth, "rr_depth": 99})
    ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(origins.T), mi.Vector3f(directions.T)))
    radiance, _, _ = integrator.sample(scene_of(world), sampler, ray)
    values = np.array(radiance).T.reshape(size[1], size[0], spp, 3).astype(np.float64)
    return values.mean(axis=2), values.std(axis=2) / np.sqrt(spp)
