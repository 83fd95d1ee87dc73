"""Phong as a Mitsuba BSDF: f = ρ_d/π + ρ_s (n+2)/(2π) max(0, r·ω_o)ⁿ, r the mirror of ω_i about the normal.

Sampling mixes a cosine lobe and a lobe cosⁿ about r, in the ratio of ρ_d to ρ_s (Lafortune and Willems 1994).
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderers.reference.bsdf import TwoLobes
from renderers.reference.variant import mitsuba

mi = mitsuba()


class Phong(TwoLobes):
    """Plugin `luxmeter_phong`; properties diffuse (texture), specular_{r,g,b}, exponent, split: share of specular samples."""

    def __init__(self, props: Any) -> None:
        super().__init__(props)
        self.diffuse = props.get_texture("diffuse")
        self.specular = mi.Color3f(*[props[f"specular_{c}"] for c in "rgb"])
        self.exponent = mi.Float(props["exponent"])
        self.split = mi.Float(props["split"])

    def direction(self, si: Any, sample1: Any, sample2: Any, active: Any) -> Any:
        """From the glossy lobe or the diffuse one."""
        glossy = sample1 < self.split
        cos = dr.power(sample2.x, 1 / (self.exponent + 1))
        sin = dr.safe_sqrt(1 - cos * cos)
        s, c = dr.sincos(dr.two_pi * sample2.y)
        lobe = mi.Frame3f(mi.reflect(si.wi)).to_world(mi.Vector3f(c * sin, s * sin, cos))
        return dr.select(glossy, lobe, mi.warp.square_to_cosine_hemisphere(sample2))

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        """f·cos and the density that `direction` has."""
        cos_i, cos_o = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
        active = active & (cos_i > 0) & (cos_o > 0)
        lobe = dr.power(dr.maximum(dr.dot(mi.reflect(si.wi), wo), 0), self.exponent)
        f = self.diffuse.eval(si, active) * dr.inv_pi + self.specular * ((self.exponent + 2) * dr.inv_two_pi * lobe)
        density = (1 - self.split) * dr.inv_pi * cos_o + self.split * (self.exponent + 1) * dr.inv_two_pi * lobe
        return dr.select(active, f * cos_o, 0), dr.select(active, density, 0)

    def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
        """Diffuse colour, textured."""
        return self.diffuse.eval(si, active)

    def to_string(self) -> str:
        """Name and parameters."""
        return f"Phong[exponent={self.exponent}]"


mi.register_bsdf("luxmeter_phong", Phong)
