"""What Mitsuba itself sees through the pixel centres: the arrays that GL and ray-cast G-buffers are checked against."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderers.reference.export import mitsuba_scene
from renderers.reference.variant import mitsuba
from renderers.scene.world import World

mi = mitsuba()


def first_hits(world: World, size: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """First hits through the pixel centres in World units; zeros where there is none. `size` is (width, height).

    coverage, emitter bool (H, W): a surface is hit; it belongs to an emissive material. position float32 (H, W, 3).
    normal float32 (H, W, 3): unit interpolated normal, turned to the viewer (the geometric one on emitters).
    albedo float32 (H, W, 3): base colour × texture (Phong: the diffuse colour).
    """
    return hits_of(mitsuba_scene(world, size), size)


def hits_of(scene: Any, size: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """`first_hits` of an exported scene."""
    width, height = size
    pixel = dr.arange(mi.UInt32, width * height)
    row = pixel // width
    place = (mi.Point2f(pixel - row * width, row) + 0.5) / mi.Point2f(width, height)
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    si = scene.ray_intersect(mi.Ray3f(ray))
    valid = si.is_valid()
    normal = mi.Vector3f(si.sh_frame.n)
    normal = dr.select(dr.dot(normal, ray.d) > 0, -normal, normal)
    albedo = si.bsdf().eval_diffuse_reflectance(si, valid)

    def image(value: Any) -> NDArray[Any]:
        return np.array(dr.select(valid, value, 0), dtype=np.float32).T.reshape(height, width, 3)

    def mask(value: Any) -> NDArray[np.bool_]:
        return np.array(valid & value, dtype=bool).reshape(height, width)

    return {
        "coverage": mask(mi.Bool(True) & valid),
        "emitter": mask(si.shape.is_emitter()),
        "position": image(si.p),
        "normal": image(normal),
        "albedo": image(albedo),
    }
