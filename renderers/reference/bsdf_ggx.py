"""glTF 2.0 metallic-roughness (Appendix B) as a Mitsuba BSDF.

    f0 = lerp(0.04, base, metallic)      c_diff = base (1 - metallic)      F = f0 + (1 - f0)(1 - |v·h|)⁵
    f = (1 - F) c_diff/π + F·D·Vis
    D = α² / (π((n·h)²(α² - 1) + 1)²)
    Vis = 0.5 / (nl √(nv²(1 - α²) + α²) + nv √(nl²(1 - α²) + α²))

Sampling mixes a cosine lobe with visible normals drawn on spherical caps (Dupuy and Benyoub 2023); the share of each is the Fresnel
reflectance at the angle of view against the remaining diffuse albedo.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderers.reference.bsdf import TwoLobes
from renderers.reference.variant import mitsuba

mi = mitsuba()
# Neither lobe of a dielectric gets less than this share of the samples, so no direction that reflects has a vanishing density.
LEAST_SHARE = 0.1


class GGX(TwoLobes):
    """Plugin `luxmeter_ggx`; properties base (texture), metallic, alpha."""

    def __init__(self, props: Any) -> None:
        super().__init__(props)
        self.base = props.get_texture("base")
        self.metallic = mi.Float(props["metallic"])
        self.alpha = mi.Float(props["alpha"])

    def _colours(self, si: Any, active: Any) -> tuple[Any, Any]:
        base = self.base.eval(si, active)
        return dr.lerp(mi.Color3f(0.04), base, self.metallic), base * (1 - self.metallic)

    def _split(self, f0: Any, c_diff: Any, cos_i: Any) -> Any:
        """Share of samples for the specular lobe."""
        fresnel = _schlick(f0, cos_i)
        glossy, diffuse = dr.max(fresnel), dr.max((1 - fresnel) * c_diff)
        share = dr.clip(glossy / dr.maximum(glossy + diffuse, 1e-20), LEAST_SHARE, 1 - LEAST_SHARE)
        return dr.select(diffuse > 0, share, 1)

    def direction(self, si: Any, sample1: Any, sample2: Any, active: Any) -> Any:
        """From the glossy lobe or the diffuse one."""
        f0, c_diff = self._colours(si, active)
        glossy = sample1 < self._split(f0, c_diff, mi.Frame3f.cos_theta(si.wi))
        half = _visible_normal(si.wi, self.alpha, sample2)
        return dr.select(glossy, mi.reflect(si.wi, half), mi.warp.square_to_cosine_hemisphere(sample2))

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        """f·cos and the density that `direction` has."""
        nv, nl = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
        active = active & (nv > 0) & (nl > 0)
        f0, c_diff = self._colours(si, active)
        half = dr.normalize(si.wi + wo)
        fresnel = _schlick(f0, dr.abs(dr.dot(si.wi, half)))
        a2 = dr.square(self.alpha)
        # The textbook denominator (n·h)²(α² - 1) + 1 cancels in float32 for small α; this is the same number without a difference.
        d = a2 * dr.inv_pi / dr.square(dr.square(half.x) + dr.square(half.y) + a2 * dr.square(half.z))
        root_v, root_l = (dr.sqrt(dr.square(n) * (1 - a2) + a2) for n in (nv, nl))
        vis = 0.5 / (nl * root_v + nv * root_l)
        f = (1 - fresnel) * c_diff * dr.inv_pi + fresnel * (d * vis)
        split = self._split(f0, c_diff, nv)
        # Visible normals: D G1 (v·h)/nv per half vector, over 4 (v·h) per direction, with G1/nv = 2/(nv + root_v).
        density = (1 - split) * dr.inv_pi * nl + split * d / (2 * (nv + root_v))
        return dr.select(active, f * nl, 0), dr.select(active, density, 0)

    def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
        """Base colour, textured."""
        return self.base.eval(si, active)

    def to_string(self) -> str:
        """Name and parameters."""
        return f"GGX[metallic={self.metallic}, alpha={self.alpha}]"


def _schlick(f0: Any, cos: Any) -> Any:
    return f0 + (1 - f0) * dr.power(dr.clip(1 - cos, 0, 1), 5)


def _visible_normal(wi: Any, alpha: Any, sample: Any) -> Any:
    """Half vector with density D G1 max(0, v·h) / (n·v): uniform on the cap of the stretched hemisphere seen from wi."""
    stretched = dr.normalize(mi.Vector3f(alpha * wi.x, alpha * wi.y, wi.z))
    z = (1 - sample.y) * (1 + stretched.z) - stretched.z
    sin = dr.safe_sqrt(1 - z * z)
    s, c = dr.sincos(dr.two_pi * sample.x)
    cap = mi.Vector3f(c * sin, s * sin, z) + stretched
    return dr.normalize(mi.Vector3f(alpha * cap.x, alpha * cap.y, cap.z))


mi.register_bsdf("luxmeter_ggx", GGX)
