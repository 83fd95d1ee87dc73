"""Materials, cameras and lights as glTF JSON; what glTF can't say goes into extras.luxmeter beside an approximation."""

from __future__ import annotations

import math
from typing import Any

from renderers.scene.gltf.extras import put_extras
from renderers.scene.model import (
    GGX,
    Camera,
    Color,
    DirectionalLight,
    DiscLight,
    Lambert,
    Light,
    Material,
    SceneError,
    SphereLight,
    SpotLight,
)

NEAR = 1e-3
Json = dict[str, Any]


def named(name: str, data: Json) -> Json:
    """`data` with its name in front, where there is one."""
    return {"name": name, **data} if name else data


def material_json(material: Material) -> Json:
    """A material; Phong stands in extras.luxmeter beside a rough dielectric. Raises SceneError for colours beyond [0, 1]."""
    own: Json | None = None
    if isinstance(material, Lambert):
        base, metallic, roughness = material.albedo, 0.0, 1.0
    elif isinstance(material, GGX):
        base, metallic, roughness = material.base_color, material.metallic, material.roughness
        if metallic == 0 and roughness == 1:
            own = {"model": "ggx"}
    else:
        base = (min(material.diffuse[0], 1.0), min(material.diffuse[1], 1.0), min(material.diffuse[2], 1.0))
        # Beckmann-like width of a Phong lobe: alpha² = 2 / (n + 2), roughness = sqrt(alpha)  (Walter et al. 2007, section 5.2)
        metallic, roughness = 0.0, (2 / (material.exponent + 2)) ** 0.25
        own = {"model": "phong", "diffuse": material.diffuse, "specular": material.specular, "exponent": material.exponent}
    if not all(0 <= v <= 1 for v in (*base, metallic, roughness)):
        raise SceneError(f"material {material.name!r}: base colour, metallic and roughness must lie in [0, 1]")
    pbr: Json = {"baseColorFactor": [*base, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness}
    if material.texture is not None:
        pbr["baseColorTexture"] = {"index": material.texture}
    data = named(material.name, {"pbrMetallicRoughness": pbr})
    if material.double_sided:
        data["doubleSided"] = True
    return put_extras(data | _emission(material.emission), material.extras, own, f"material {material.name!r}")


def _emission(emission: Color) -> Json:
    """emissiveFactor in [0, 1] times a strength that is a power of two: their product is exact (above 1e-300)."""
    peak = max(emission)
    if peak == 0:
        return {}
    strength = 2.0 ** math.ceil(math.log2(peak)) if peak > 1 else 1.0
    data: Json = {"emissiveFactor": [c / strength for c in emission]}
    if strength > 1:
        data["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    return data


def camera_json(camera: Camera, radius: float) -> Json:
    """A perspective camera of a scene of half diagonal `radius`."""
    # glTF asks for a near plane; nothing in it is nearer than this share of the scene's size
    data = named(camera.name, {"type": "perspective", "perspective": {"yfov": camera.yfov, "znear": radius * NEAR}})
    return put_extras(data, camera.extras, None, f"camera {camera.name!r}")


def light_json(light: Light) -> Json:
    """A punctual light; discs and spheres stand in extras.luxmeter beside a spot or point. Raises SceneError for bad angles."""
    data = named(light.name, {"color": light.color, "intensity": light.intensity})
    own: Json | None = None
    if isinstance(light, DiscLight | SphereLight):
        # from afar both shine like their area seen face on; the disc falls off with a cosine, which a wide spot comes nearest to
        own = {"type": "sphere", "radiance": light.intensity, "color": light.color, "radius": light.radius}
        data |= {"type": "point", "intensity": light.intensity * face_on_area(light), "color": [min(c, 1.0) for c in light.color]}
        if isinstance(light, DiscLight):
            own["type"] = "disc"
            data |= {"type": "spot", "spot": {"innerConeAngle": 0.0, "outerConeAngle": math.pi / 2}}
    elif isinstance(light, SpotLight):
        if not 0 <= light.inner_angle < light.outer_angle <= math.pi / 2 + 1e-6:
            raise SceneError(f"light {light.name!r}: angles must satisfy 0 <= inner < outer <= pi/2")
        data |= {"type": "spot", "spot": {"innerConeAngle": light.inner_angle, "outerConeAngle": light.outer_angle}}
    else:
        data["type"] = "directional" if isinstance(light, DirectionalLight) else "point"
    return put_extras(data, light.extras, own, f"light {light.name!r}")


def face_on_area(light: DiscLight | SphereLight) -> float:
    """π·radius²: times the radiance, the intensity in W/sr seen face on."""
    return math.pi * light.radius**2
