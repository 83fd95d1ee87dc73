"""glTF's spot light as a Mitsuba emitter (Mitsuba's own falls off linearly in the angle).

radiant intensity(θ) = I · clamp((cos θ - cos outer) / (cos inner - cos outer), 0, 1)²
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderers.reference.variant import mitsuba

mi = mitsuba()
# Least width of the falloff in cosine: inner = outer becomes an edge, not a division by zero.
LEAST_WIDTH = 1e-6


class Spot(mi.Emitter):  # type: ignore[misc, name-defined]
    """Plugin `luxmeter_spot`; properties position, axis (unit), intensity_{r,g,b} in W/sr, cos_inner, cos_outer."""

    def __init__(self, props: Any) -> None:
        mi.Emitter.__init__(self, props)
        self.position = mi.Point3f(props["position"])
        self.axis = mi.Vector3f(props["axis"])
        self.intensity = mi.Color3f(*[props[f"intensity_{c}"] for c in "rgb"])
        self.cos_outer = mi.Float(props["cos_outer"])
        self.width = mi.Float(max(props["cos_inner"] - props["cos_outer"], LEAST_WIDTH))
        self.m_flags = +mi.EmitterFlags.DeltaPosition

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
        """The one direction to the light, and intensity × falloff / distance²."""
        ds = mi.DirectionSample3f()
        ds.p = self.position
        ds.n = mi.Normal3f(0)
        ds.uv = mi.Point2f(0)
        ds.pdf = mi.Float(1)
        ds.time = it.time
        ds.delta = mi.Bool(True)
        ds.emitter = mi.EmitterPtr(self)
        ds.d = ds.p - it.p
        ds.dist = dr.norm(ds.d)
        ds.d /= ds.dist
        return ds, self.eval_direction(it, ds, active)

    def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """0: no other technique finds a point."""
        return mi.Float(0)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """Intensity × falloff / distance² along ds.d."""
        falloff = dr.square(dr.clip((dr.dot(-ds.d, self.axis) - self.cos_outer) / self.width, 0, 1))
        return dr.select(active, self.intensity * (falloff / dr.square(ds.dist)), 0)

    def eval(self, si: Any, active: Any = True) -> Any:
        """0: a point is never hit."""
        return mi.Color3f(0)

    def bbox(self) -> Any:
        """Empty: a point adds nothing to the bounds of a scene."""
        return mi.ScalarBoundingBox3f()

    def to_string(self) -> str:
        """Name."""
        return "Spot[]"


mi.register_emitter("luxmeter_spot", Spot)
